"""When, without any step, what formulas ask of derived signals turns: the deadlines of the properties that ask it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace

from oracle_server.core.atoms import canonical
from oracle_server.core.derived.flips import Answer, answer, answer_beside
from oracle_server.core.derived.keyed import Keyed, key_of, value_of
from oracle_server.core.derived.layout import Watched
from oracle_server.core.derived.queue import Key
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import Asked, Series, Session, least
from oracle_server.core.events import Signals
from oracle_server.core.formula.tree import Any, Constraint, Ref, Signal

Carried = tuple[str, Key]
"""A signal, and a value of it for which something turned."""
Seen = Callable[[int, Signals], tuple[Signals, Collection[str]]]
"""The signals of a tick at a time (ns) that carries some, with all that is derived, and those that failed."""
_NONE = frozenset[int]()
_ANY_CHANGE = Ref("")
"""What a variable is bound to changes with each change of a value."""


class Watch:
    """It looks ahead from one step, and is forgotten with the next: nothing that it does is state."""

    def __init__(
        self,
        watched: Sequence[Watched],
        series: Sequence[Series],
        bys: Sequence[str],
        session: Session,
        present: int,
        steps: int,
        held: Signals,
        see: Seen,
    ) -> None:
        """Look from the last step, at `present` (ns), of `steps`; or from the session's begin. `held` are signals."""
        self._held, self._see = held, see
        self._plain = [(w, series[w.index]) for w in watched if not bys[w.index]]
        self._keyed = [(w, found, bys[w.index]) for w in watched if isinstance(found := series[w.index], Keyed)]
        self._steps = steps
        self._at = present if steps or session.begun is None else session.begun
        self._next: tuple[int, int | None] | None = None
        self._answers = [self._answers_of(w, found, self._at, {}) for w, found in self._plain]
        self.turned: set[int] = set()
        """The properties for which something turned."""
        self.keys: dict[Carried, set[int]] = {}
        """The same for one key only."""

    def next_change(self, after: int) -> int | None:
        """The first time (ns) later than `after` at which something may turn, None for never."""
        after = max(after, self._at)
        if self._next is not None and self._next[0] <= after and (self._next[1] is None or after < self._next[1]):
            return self._next[1]
        found = least(
            *(series.next_change(after, self._wanted(w, after)) for w, series in self._plain),
            *(keyed.next_change(after, self._wanted(w, after)) for w, keyed, _ in self._keyed),
        )
        self._next = after, found
        return found

    def look(self, until: int) -> tuple[bool, list[Carried]]:
        """Look on; whether something turned without a key, and for which keys, in the order of their texts."""
        plain, keys = False, dict[Carried, None]()
        while self._at < until and (time := self.next_change(self._at)) is not None and time <= until:
            plain = self._look_at(time) or plain
            keys |= dict.fromkeys(self._look_at_keys(time))
            self._at = time
        self._at = max(self._at, until)
        return plain, sorted(keys, key=_text)

    def _look_at(self, time: int) -> bool:
        turned: set[int] = set()
        for place, (watched, series) in enumerate(self._plain):
            found = self._answers_of(watched, series, time, {})
            turned |= self._turns(watched, self._answers[place], found)
            self._answers[place] = found
        self.turned |= turned
        return bool(turned)

    def _look_at_keys(self, time: int) -> list[Carried]:
        found: list[Carried] = []
        for watched, keyed, by in self._keyed:
            own = {*keyed.keys_at(time, self._wanted(watched, self._at))}
            if by in self._held:
                own.add(key_of(self._held[by]))
            for key in {*own, *self._beside(watched, keyed, time)}:
                carried = {by: value_of(key)}
                before, now = (self._answers_of(watched, keyed, t, carried) for t in (time - 1, time))
                turned = self._turns(watched, before, now, compared=key not in own)
                if turned:
                    self.keys.setdefault((by, key), set()).update(turned)
                    found.append((by, key))
        return found

    def _answers_of(self, watched: Watched, series: Series, time: int, carried: Signals) -> list[Answer]:
        value = series.at(time, self._steps, carried, ())
        if not watched.compares:
            return [answer(constraint, value) for constraint in watched.asked]
        signals, failed = self._see(time, carried)
        return [_answer_among(constraint, value, signals, failed) for constraint in watched.asked]

    def _beside(self, watched: Watched, keyed: Keyed, time: int) -> Iterator[Key]:
        """The keys that are known of what it is compared with, where an answer may turn for all of them."""
        if watched.compares and keyed.may_turn_all(time):
            others = {c.value.name for c in watched.asked if isinstance(c.value, Signal)}
            for w, other, _ in self._keyed:
                if w.asked[0].key in others:
                    yield from other.known_before(time)

    def _wanted(self, watched: Watched, after: int) -> Asked:
        """What is asked up to the next change, of what it is compared with too: this is a number until then."""
        if not watched.compares:
            return watched.asked
        signals, _ = self._see(after, {})
        return [_against(watched, constraint, signals) for constraint in watched.asked]

    def _turns(
        self, watched: Watched, before: Sequence[Answer], now: Sequence[Answer], *, compared: bool = False
    ) -> frozenset[int]:
        """The properties for which answers differ. What is absent is not met, but before the first step not known.

        `compared`: only where another signal is asked for, for a key that is known of that one alone.
        """
        turns = (
            properties
            for asked, was, is_now, properties in zip(watched.asked, before, now, watched.properties, strict=True)
            if was != is_now
            and (not self._steps or (was or False) != (is_now or False))
            and (not compared or isinstance(asked.value, Signal))
        )
        return _NONE.union(*turns)


def _answer_among(constraint: Constraint, value: Value | None, signals: Signals, failed: Collection[str]) -> Answer:
    if not isinstance(constraint.value, Signal):
        return answer(constraint, value)
    other = constraint.value.name
    return answer_beside(constraint, value, FAILED if other in failed else signals.get(other))


def _against(watched: Watched, constraint: Constraint, signals: Signals) -> Constraint:
    """What a comparison asks of its first signal, where the other is as it is among these."""
    if not isinstance(constraint.value, Signal):
        return constraint
    name = constraint.value.name
    if name in watched.moving:
        return replace(constraint, op="==", value=_ANY_CHANGE)
    other = None if name in watched.abreast else signals.get(name)
    if other is None or isinstance(other, str | bool):
        return replace(constraint, op="==", value=Any.ANY)
    return replace(constraint, value=other)


def _text(carried: Carried) -> tuple[str, str]:
    by, key = carried
    return canonical(value_of(key)), by
