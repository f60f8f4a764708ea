"""What is awaited between the operators that wait: parts that only look back, `and`, `or`, and `next`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

from oracle_server.core.lost import Lost
from oracle_server.engines.native.body import NOTHING, Body
from oracle_server.engines.native.compared import Limit, is_right
from oracle_server.engines.native.keys import Key, Variables, picker, read_key, texts_of
from oracle_server.engines.native.waiting import (
    FALSE,
    LOST,
    OPEN,
    Above,
    Awaited,
    Moment,
    Present,
    all_of,
    any_of,
)

Reading = tuple[Variables, Sequence[tuple[str, int]]]
"""The variables at the refs of an atom, 0 for one of its own, and those with which it compares, and how."""


class Pattern(NamedTuple):
    """Values of all variables, None where it is any that compares so."""

    texts: tuple[str | None, ...]
    limits: Sequence[Limit] = ()


class Leaf:
    """A part that only looks back: it answers at once."""

    above: Above
    slot = 0

    def __init__(self, body: Body, size: int, reads: Mapping[int, Reading]) -> None:
        """`body` is over some of `size` variables, which have the numbers from 1 on; `reads` are its atoms."""
        self._size, self._reads = size, reads
        self.places = [v - 1 for v in body.variables]
        self.pick: Callable[[Key], Key] | None = picker(self.places, size)
        self.body = body
        self.holds = _holds(body.at[0], self.pick)
        """Whether it holds for a key, as far as it can be judged."""
        self.lost: list[Pattern] = []
        """For which values it can't be judged at the present step."""

    def lose(self, lost: Collection[Lost]) -> None:
        """At the present step these atoms can't be judged, with these values at their refs."""
        self.lost = []
        for atom, texts in lost:
            if atom in self._reads:
                refs, compared = self._reads[atom]
                pattern: list[str | None] = [None] * self._size
                for variable, text in zip(refs, texts, strict=False):
                    if variable:
                        pattern[variable - 1] = pattern[variable - 1] or text
                values = texts[len(refs) :]
                limits = [(v - 1, op, value) for (op, v), value in zip(compared, values, strict=True)]
                self.lost.append(Pattern(tuple(pattern), limits))

    def changed(self) -> Collection[Key]:
        """The keys of its own variables at which it may have changed with this step."""
        return self.body.touched(NOTHING)

    def value(self, key: Key) -> int:
        """Whether it holds at the present step, or can't be judged."""
        if self.lost and any(fits(pattern, key) for pattern in self.lost):
            return LOST
        return int(self.holds(key))

    def step(self, key: Key, ask: bool) -> int:
        """The answer about the present step."""
        return self.value(key) if ask else OPEN

    def cancel(self, key: Key, about: Moment) -> None:
        """Nothing is open."""

    def passed(self, key: Key) -> None:
        """Nothing is open."""

    def quiet(self, key: Key) -> int | None:
        """Its value, as long as it does not change."""
        return int(self.holds(key))

    def is_still(self, key: Key) -> bool:  # noqa: ARG002 -- at all of them
        """Nothing is open."""
        return True

    def snapshot(self) -> Any:
        """Nothing is open."""
        return None

    def restore(self, data: Any) -> None:
        """Nothing was open."""


def _holds(at: Callable[[Key], bool], pick: Callable[[Key], Key] | None) -> Callable[[Key], bool]:
    return at if pick is None else lambda key: at(pick(key))


def fits(pattern: Pattern, key: Key) -> bool:
    """Whether a pattern stands for a key."""
    texts = texts_of(key)
    there = all(wanted is None or wanted == text for wanted, text in zip(pattern.texts, texts, strict=True))
    return there and is_right(pattern.limits, texts)


class Joined:
    """`φ and ψ`, or `φ or ψ` where `absorbing` is true: one side that is absorbing decides."""

    above: Above
    slot = 0

    def __init__(self, present: Present, left: Awaited, right: Awaited, *, absorbing: int) -> None:
        self._present, self._sides, self._absorbing = present, (left, right), absorbing
        self._join = all_of if absorbing == FALSE else any_of
        self._waits: dict[Key, dict[Moment, tuple[int, int]]] = {}
        for slot, side in enumerate(self._sides):
            side.above, side.slot = self, slot

    def step(self, key: Key, ask: bool) -> int:
        """The answer about the present step; see `Awaited`."""
        left = self._sides[0].step(key, ask)
        right = self._sides[1].step(key, ask and left != self._absorbing)
        if not ask:
            return OPEN
        if left == self._absorbing:
            return left
        value = self._join((left, right))
        moment, present = self._present.moment, self._present
        if value == OPEN:
            if key not in self._waits:
                present.put(self._waits, key, {})
            present.put(self._waits[key], moment, (left, right))
        elif left == OPEN:
            self._sides[0].cancel(key, moment)
        return value

    def resolved(self, key: Key, slot: int, about: Moment, value: int) -> None:
        """Take an answer that was open."""
        waits = self._waits.get(key)
        if waits is None or about not in waits:
            return
        left, right = (value, waits[about][1]) if slot == 0 else (waits[about][0], value)
        found = self._join((left, right))
        if found == OPEN:
            self._present.put(waits, about, (left, right))
            return
        self._forget(key, about)
        other = 1 - slot
        if (left, right)[other] == OPEN:
            self._sides[other].cancel(key, about)
        self.above.resolved(key, self.slot, about, found)

    def cancel(self, key: Key, about: Moment) -> None:
        """Forget an open question."""
        waits = self._waits.get(key)
        if waits is None or about not in waits:
            return
        for side, value in zip(self._sides, self._forget(key, about), strict=True):
            if value == OPEN:
                side.cancel(key, about)

    def passed(self, key: Key) -> None:
        """Settle what time has decided."""
        for side in self._sides:
            side.passed(key)

    def quiet(self, key: Key) -> int | None:
        """The answer about a step at which no operand changes."""
        left, right = (side.quiet(key) for side in self._sides)
        if left == self._absorbing:
            return left
        return None if left is None or right is None else self._join((left, right))

    def is_still(self, key: Key) -> bool:
        """Whether both sides are."""
        return all(side.is_still(key) for side in self._sides)

    def snapshot(self) -> Any:
        """All that is open as plain data."""
        waits = [(key, list(found.items())) for key, found in self._waits.items()]
        return [waits, *(side.snapshot() for side in self._sides)]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        waits, *sides = data
        for key, found in waits:
            self._waits[read_key(key)] = {(t, n): (left, right) for (t, n), (left, right) in found}
        for side, saved in zip(self._sides, sides, strict=True):
            side.restore(saved)

    def _forget(self, key: Key, about: Moment) -> tuple[int, int]:
        found = self._present.pop(self._waits[key], about)
        if not self._waits[key]:
            self._present.pop(self._waits, key)
        return found


class Next:
    """`next φ`: about a step it is what φ is about the one after it."""

    above: Above
    slot = 0

    def __init__(self, present: Present, operand: Awaited) -> None:
        self._present, self._operand = present, operand
        operand.above, operand.slot = self, 0
        self._asked: dict[Key, Moment] = {}
        """The last step, where that is to be followed."""
        self._pending: dict[Key, dict[Moment, Moment]] = {}
        """By the step after it, each step of which the answer about that one is open."""

    def step(self, key: Key, ask: bool) -> int:
        """Take the present step; see `Awaited`."""
        present, moment = self._present, self._present.moment
        asks = key in self._asked
        value = self._operand.step(key, asks)
        before = self._asked.get(key)  # what it told may have cancelled this
        if before is None:
            if asks and value == OPEN:
                self._operand.cancel(key, moment)
        else:
            present.pop(self._asked, key)
            if value == OPEN:
                if key not in self._pending:
                    present.put(self._pending, key, {})
                present.put(self._pending[key], moment, before)
            else:
                present.count(-1)
                self.above.resolved(key, self.slot, before, value)
        if ask:
            present.count(1)
            present.put(self._asked, key, moment)
        return OPEN

    def resolved(self, key: Key, slot: int, about: Moment, value: int) -> None:  # noqa: ARG002 -- there is one
        """Take an answer that was open."""
        pending = self._pending.get(key)
        if pending is None or about not in pending:
            return
        start = self._forget(key, about)
        self.above.resolved(key, self.slot, start, value)

    def cancel(self, key: Key, about: Moment) -> None:
        """Forget an open question."""
        if self._asked.get(key) == about:
            self._present.pop(self._asked, key)
            self._present.count(-1)
            return
        after = next((after for after, start in self._pending.get(key, {}).items() if start == about), None)
        if after is not None:
            self._forget(key, after)
            self._operand.cancel(key, after)

    def passed(self, key: Key) -> None:
        """Settle what time has decided: nothing follows where all has ended."""
        self._operand.passed(key)
        if self._present.ended and key in self._asked:
            self._present.count(-1)
            self.above.resolved(key, self.slot, self._present.pop(self._asked, key), FALSE)

    def quiet(self, key: Key) -> int | None:  # noqa: ARG002 -- each step is waited about
        """None: each step is waited about."""
        return None

    def is_still(self, key: Key) -> bool:
        """Whether no step is to be followed."""
        return key not in self._asked and self._operand.is_still(key)

    def snapshot(self) -> Any:
        """All that is open as plain data."""
        pending = [(key, list(found.items())) for key, found in self._pending.items()]
        return [list(self._asked.items()), pending, self._operand.snapshot()]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        asked, pending, operand = data
        self._asked = {read_key(key): (t, n) for key, (t, n) in asked}
        for key, found in pending:
            self._pending[read_key(key)] = {(t, n): (s, m) for (t, n), (s, m) in found}
        self._operand.restore(operand)

    def _forget(self, key: Key, about: Moment) -> Moment:
        self._present.count(-1)
        start = self._present.pop(self._pending[key], about)
        if not self._pending[key]:
            self._present.pop(self._pending, key)
        return start
