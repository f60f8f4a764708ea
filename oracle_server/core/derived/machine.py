"""The states of machines, step by step: of one, or of one for each value of a signal."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, Final

import msgspec

from oracle_server.core.derived.definition import MAX_MACHINES, Definition
from oracle_server.core.derived.journal import Was
from oracle_server.core.derived.keyed import key_of, names_of, texts_of, value_of
from oracle_server.core.derived.queue import Key, Queue
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import Asked, Session
from oracle_server.core.events import Signals
from oracle_server.core.formula.tree import Scalar

_SHORT: Final = 256
"""Texts of fewer characters are keys as they are."""
_ONE: Final = ""
"""The key of a machine that is the only one."""
_FEW: Final = 1024
"""So many machines are kept before it is looked which are forgotten."""
_MOST_WAYS: Final = 1024
"""The different events at once that are remembered for a state."""


class Standing(msgspec.Struct, frozen=True, gc=False):
    """How a machine stands: its state, by which event, and since which step; the same of the state before.

    `at` is the time (ns) of its last event, where machines are forgotten. Tens of thousands are kept.
    """

    state: int
    event: int = -1
    since: int = 0
    was: int = -1
    was_event: int = -1
    was_since: int = 0
    at: int = 0


class _Had(msgspec.Struct, frozen=True, gc=False):
    """Lets a machine stand as it stood, None for one that there was not."""

    put: Callable[[Key, Standing | None], None]
    key: Key
    standing: Standing | None

    def __call__(self) -> None:
        """Take the change back."""
        self.put(self.key, self.standing)


class Machines:
    """Machines of one kind; a `Series`, of which time alone changes nothing but that some are forgotten."""

    def __init__(self, definition: Definition, session: Session) -> None:
        assert definition.table is not None  # noqa: S101 -- machines have one
        self.table, self._session = definition.table, session
        self.by = definition.by
        """The signals whose values tell machines apart: here one at most."""
        self._by = "".join(definition.by[:1])
        self._values = self.table.values
        self._life = definition.forget
        """How long a machine is kept after its last event, None for ever."""
        self._standings: dict[Key, Standing] = {}
        self._look_at = self.most if self._life is None else min(_FEW, self.most)
        """At how many machines it is looked which are forgotten: so each event costs the same."""
        self._queue = Queue(session.journal)
        """The machines in the order of their last events, as they stood when it was filled; those since are later."""
        self._ways: list[dict[int, tuple[int, int]]] = [{} for _ in self.table.rows]
        """Where a state goes at a step with some events, and by which, as the table has it."""
        self._blind: int | None = None
        """When (ns) there was an event last of which the machine is not known: it may be any."""
        self._crowded: int | None = None
        """The same of one for which there was no room."""
        self._fresh, self._unknown = Standing(self.table.start), Standing(self.table.any)
        self.last = 0
        self._unput = self._put

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Take the events of a step, as bits; returns what the signal is with them."""
        key: Key = _ONE
        if self._blind is not None or self._crowded is not None:
            self._let_go_of_marks(now)
        if self._by:
            value = signals.get(self._by)
            if value is None:
                return self._lose_all(now) if self._by in failed else None
            key = value if type(value) is str and len(value) < _SHORT else key_of(value)
        had = self._standings.get(key)
        if had is None and len(self._standings) >= self._look_at and not self._has_room(now):
            self._change("_crowded", now)
            return FAILED
        state = self._move(key, had, sample, now, number).state
        return self._values[state] if state >= 0 else self._value(state)

    def value(self, now: int, _number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """What it is at a step, of the machine of that step."""
        return self._value_at(now, signals, failed)

    def at(self, now: int, _number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """What it is at a tick, of the machine whose key this carries, or that is held."""
        return self._value_at(now, signals, failed)

    def next_change(self, _after: int, _asked: Asked) -> int | None:
        """Time alone changes nothing that is awaited."""
        return None

    def settled(self, _now: int, _number: int) -> bool:
        """Whether no machine is kept."""
        return not self._standings

    def shown(self, now: int, signals: Signals) -> tuple[tuple[Scalar, ...], Standing] | None:
        """The machine of a step or tick, by the values of what tells machines apart, and how it stands at a time (ns).

        None where the step does not tell which one it is.
        """
        if not self._by:
            return (), self._known(self._standings.get(_ONE), now)
        value = signals.get(self._by)
        return None if value is None else ((value,), self._known(self._standings.get(key_of(value)), now))

    @property
    def lack(self) -> str:
        """Why it may have failed for some machine, empty for no reason of its own."""
        names = names_of(self.by)
        if self._crowded is not None:
            return f"more than {self.most:,} values of {names}"
        return f"{names} has failed" if self._blind is not None else ""

    @property
    def most(self) -> int:
        """The most machines that are kept."""
        return MAX_MACHINES

    def snapshot(self) -> Any:
        """How all stand, as plain data."""
        known = sorted(self._standings.items(), key=lambda each: texts_of(each[0]))
        standings = [
            [self._written(key), str(s.state), s.event, s.since, str(s.was), s.was_event, s.was_since, s.at]
            for key, s in known
        ]
        return [standings, self._blind, self._crowded]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        standings, self._blind, self._crowded = data
        for value, state, event, since, was, *rest in standings:
            self._put(self._read(value), Standing(int(state), event, since, int(was), *rest))

    def _move(self, key: Key, had: Standing | None, sample: Any, now: int, number: int) -> Standing:
        """How a machine stands that stood so at its last event before a step; None for one that is new."""
        after = self._after(self._known(had, now), sample, number, 0 if self._life is None else now)
        if after is not had:
            self._put(key, after)
            if self._session.journal.entries is not None:
                self._session.journal.entries.append(_Had(self._unput, key, had))
        return after

    def _put(self, key: Key, standing: Standing | None) -> None:
        """Let a machine stand so; None where there is to be none."""
        if standing is None:
            del self._standings[key]
        else:
            self._standings[key] = standing

    def _written(self, key: Key) -> Any:
        """A key as plain data."""
        return value_of(key)

    def _read(self, data: Any) -> Key:
        """A key out of plain data."""
        return key_of(data)

    def _after(self, standing: Standing, sample: int, number: int, at: int) -> Standing:
        """How a machine stands behind the events of step `number`."""
        state = standing.state
        found, event = (self._ways[state].get(sample) if state >= 0 else None) or self._way(state, sample)
        if found != state:
            return Standing(found, event, number, state, standing.event, standing.since, at)
        if at == standing.at:
            return standing
        was, was_event, was_since = standing.was, standing.was_event, standing.was_since
        return Standing(state, standing.event, standing.since, was, was_event, was_since, at)

    def _way(self, state: int, sample: int) -> tuple[int, int]:
        """Where the table leads from a state, and by which event."""
        found = self.table.after(state, sample), self.table.event(state, sample)
        if state >= 0 and len(self._ways[state]) < _MOST_WAYS:
            self._ways[state][sample] = found
        return found

    def _value_at(self, now: int, signals: Signals, failed: Collection[str]) -> Value | None:
        key: Key = _ONE
        if self._by:
            value = signals.get(self._by)
            if value is None:
                return FAILED if self._by in failed else None
            key = key_of(value)
        return self._value(self._known(self._standings.get(key), now).state)

    def _value(self, state: int) -> Value | None:
        """What the signal is in a state, `FAILED` where it may be one of several."""
        found = self.table.alike(state)
        return found[0] if len(found) == 1 else FAILED

    def _known(self, standing: Standing | None, now: int) -> Standing:
        """How a machine stands that stood so at its last event."""
        is_kept = standing is not None and (self._life is None or standing.at + self._life > now)
        return standing if standing is not None and is_kept else self._unseen(now)

    def _unseen(self, now: int) -> Standing:
        """How one stands of which no event is remembered: where events were lost, it may have had any."""
        lost = [at for at in (self._blind, self._crowded) if at is not None]
        return self._unknown if any(self._life is None or at + self._life > now for at in lost) else self._fresh

    def _lose_all(self, now: int) -> Value:
        """Note an event that may be of any machine: of none is known how it stands."""
        self._change("_blind", now)
        self._change("_standings", {})
        return FAILED

    def _let_go_of_marks(self, now: int) -> None:
        """Forget events of unknown machines that are long ago."""
        if self._life is None:
            return
        limit = now - self._life
        if self._blind is not None and self._blind <= limit:
            self._change("_blind", None)
        if self._crowded is not None and self._crowded <= limit:
            self._change("_crowded", None)

    def _has_room(self, now: int) -> bool:
        """Whether one more machine may be kept, once those are gone that are forgotten by now (ns)."""
        if self._life is not None:
            self._let_go(now - self._life)
        return len(self._standings) < self.most

    def _let_go(self, limit: int) -> None:
        """Let go of the machines that had no event later than a time (ns)."""
        self._pass_by(limit)
        if self._queue.is_spent:
            self._queue.fill(sorted(((s.at, key) for key, s in self._standings.items()), key=lambda pair: pair[0]))
            self._pass_by(limit)
        self._look_at = min(self.most, 2 * max(_FEW, len(self._standings)))

    def _pass_by(self, limit: int) -> None:
        """Let go of those of the queue alone."""
        undone = self._session.journal.entries
        for key in self._queue.pass_by(limit):
            standing = self._standings.get(key)
            if standing is not None and standing.at <= limit:
                if undone is not None:
                    undone.append(_Had(self._unput, key, standing))
                self._put(key, None)

    def _change(self, name: str, value: object) -> None:
        if self._session.journal.entries is not None:
            self._session.journal.entries.append(Was(self, name, getattr(self, name)))
        setattr(self, name, value)
