"""What a machine does: its states, its events, and where each event leads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

ERROR = "error"
"""The state of a machine at an event that its state has not."""
MAX_STATES = 1_000


@dataclass(frozen=True, slots=True)
class Limit:
    """A state that is to be left again: within so long (ns), None for at any time."""

    state: str
    within: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """What a machine does at each step, by its state.

    Its states are numbered, and `names` has what people call them, `values` what the signal is there, None for absent.
    Its events are bits, of which a step has some: those that hold at it, and, higher by the number of events, those of
    which it is not known. `rows` has for each state the states that events lead to, in order: the first that holds
    counts. Where events hold, and none of the row, the machine goes to the state's `otherwise`. It is `bad` where its
    signal says so. A state is negative where it may be one of several: the bits of its absolute value.
    """

    names: tuple[str, ...]
    values: tuple[str | None, ...]
    events: tuple[str, ...]
    rows: tuple[Mapping[int, int], ...]
    otherwise: tuple[int, ...]
    start: int
    bad: str = ERROR
    limits: tuple[Limit, ...] = ()

    @property
    def any(self) -> int:
        """The state of which nothing is known."""
        return _among(range(len(self.names)))

    @property
    def can_err(self) -> bool:
        """Whether any events lead to its error."""
        found, new = {self.start}, [self.start]
        while new:
            state = new.pop()
            ways = {*self.rows[state].values()}
            ways |= {self.otherwise[state]} if len(self.rows[state]) < len(self.events) else set()
            new += ways - found
            found |= ways
        return any(self.values[state] == self.bad for state in found)

    def after(self, state: int, sample: int) -> int:
        """The state behind a step with these events."""
        held, unsure = sample & ((1 << len(self.events)) - 1), sample >> len(self.events)
        if state >= 0 and not unsure:
            return self._next(state, held)
        return _among({to for each in possible(state) for to in self._ways(each, held, unsure)})

    def alike(self, state: int) -> tuple[str | None, ...]:
        """What the signal may be: one for a state that is known."""
        return tuple(dict.fromkeys(self.values[each] for each in possible(state)))

    def event(self, state: int, sample: int) -> int:
        """The place of the event that counts at a step, or that may, in a state that is known, or among all."""
        row = self.rows[state] if state >= 0 else {}
        bits = sample & ((1 << len(self.events)) - 1) or sample >> len(self.events)
        bit = next((bit for bit in row if bits & bit), bits & -bits)
        return bit.bit_length() - 1

    def _next(self, state: int, held: int) -> int:
        for bit, to in self.rows[state].items():
            if held & bit:
                return to
        return self.otherwise[state] if held else state

    def _ways(self, state: int, held: int, unsure: int) -> Iterator[int]:
        """The states that may follow on one."""
        row = self.rows[state]
        for bit, to in row.items():
            if held & bit:
                yield to
                return
            if unsure & bit:
                yield to
        if not held:
            yield state
        if held or unsure & ~sum(row):
            yield self.otherwise[state]


def possible(state: int) -> list[int]:
    """The states that it may be."""
    if state >= 0:
        return [state]
    bits = bin(-state)[:1:-1]
    return [i for i, bit in enumerate(bits) if bit == "1"]


def _among(states: Iterable[int]) -> int:
    found = list(states)
    return found[0] if len(found) == 1 else -sum(1 << each for each in found)
