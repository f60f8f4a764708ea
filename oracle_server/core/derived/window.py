"""Windows of samples: (now - width, now], in nanoseconds, in steps, or in samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Collection
from functools import partial
from typing import Any, Final, Protocol

from oracle_server.core.derived.definition import MAX_SAMPLES, Definition
from oracle_server.core.derived.journal import Journal
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.events import Signals
from oracle_server.core.formula.tree import Constraint

TIME: Final = 0
STEPS: Final = 1
SAMPLES: Final = 2
_TRIM = 32
OFTEN = _TRIM - 1
"""Nothing of a place in a window is left by `&` with it at each 32nd: there columns are trimmed."""

Asked = Collection[Constraint]
"""What formulas ask of a derived signal at ticks."""


class Series(Protocol):
    """The state of a derived signal, for one key of it where it has several. Only `take` and `value` change it."""

    last: int
    """The number of the step of the last sample, 0 before there was one."""

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Add a sample, or `FAILED`, of a step at `now` (ns), the session's step number `number`; returns its value."""
        ...

    def value(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """What it is at a step that formulas see so far: None where it is absent."""
        ...

    def at(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """What it is at a tick later than the last step."""
        ...

    def next_change(self, after: int, asked: Asked) -> int | None:
        """A time (ns) later than `after`, up to which time alone does not change what is asked; None for never."""
        ...

    def settled(self, now: int, number: int) -> bool:
        """Whether it is as if it had never had a sample."""
        ...

    def snapshot(self) -> Any:
        """It as plain data."""
        ...

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        ...


class Budget:
    """The samples that the windows of a session hold."""

    __slots__ = ("used",)

    def __init__(self) -> None:
        self.used = 0


class Session:
    """What all series of a session share: what takes changes back, the samples held, and when the session began."""

    __slots__ = ("begun", "budget", "journal")

    def __init__(self) -> None:
        self.journal, self.budget = Journal(), Budget()
        self.begun: int | None = None
        """In nanoseconds; None before anything was."""


class Window(ABC):
    """The positions of the samples in a window, and in further columns what stands at them."""

    __slots__ = ("budget", "clock", "columns", "failed_at", "head", "journal", "last", "places", "session", "short",
                 "taken", "width")  # fmt: skip

    def __init__(self, definition: Definition, session: Session) -> None:
        assert definition.over is not None  # noqa: S101 -- `check` refuses what has none
        self.width = definition.over
        self.clock = TIME if definition.timed else STEPS if definition.formula is not None else SAMPLES
        self.session, self.journal, self.budget = session, session.journal, session.budget
        self.places: list[int] = []
        self.columns: tuple[list[Any], ...] = (self.places,)
        self.head = 0
        """Where in the columns the window begins."""
        self.taken = 0
        """How many samples there were, where the window counts samples."""
        self.failed_at: int | None = None
        """The position of the last sample that is not known."""
        self.short = False
        """Whether there was no room for that one."""
        self.last = 0
        """The number of the step of the last sample."""

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Add a sample; returns what the signal is with it."""
        if self.journal.entries is not None:
            self.journal.entries.append(partial(self._untake, self.taken, self.last))
        self.last = number
        if self.clock == TIME:
            at = now
        elif self.clock == STEPS:
            at = number
        else:
            at = self.taken = self.taken + 1
        if sample is FAILED or self.budget.used >= MAX_SAMPLES:
            self._take_or_fail(at, sample)
        else:
            self.add(at, sample)
        return self.value(now, number, signals, failed)

    @abstractmethod
    def value(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """What the signal is at a step."""

    def add(self, at: int, _sample: Value) -> None:
        """Put a sample into the columns."""
        self.places.append(at)
        self.budget.used += 1
        if self.journal.entries is not None:
            self.journal.entries.append(self._unadd)

    def move(self, limit: int) -> None:
        """Let go of what is at positions up to a limit."""
        places, head = self.places, self.head
        if head < len(places) and places[head] <= limit:
            head += 1  # as most often
            if head < len(places) and places[head] <= limit:
                head = bisect_right(places, limit, head)
            self.leave(head)

    def leave(self, head: int) -> None:
        """Let the window begin further on."""
        before = self.head
        self.head = head
        self.budget.used -= head - before
        entries = self.journal.entries
        if entries is not None:
            entries.append(partial(self.unleave, before))
        if head >= _TRIM and 2 * head > len(self.places):
            if entries is not None:
                entries.append(partial(self._untrim, [column[:head] for column in self.columns]))
            for column in self.columns:
                del column[:head]
            self.head = 0

    def size(self, now: int) -> int:
        """How many samples are kept in a window that ends at a time, or with the last step."""
        limit = self.position(now, self.last) - self.width
        return len(self.places) - bisect_right(self.places, limit, self.head)

    def position(self, now: int, number: int) -> int:
        """Where a window ends that is looked at now."""
        return now if self.clock == TIME else number if self.clock == STEPS else self.taken

    def fails(self, limit: int) -> bool:
        """Whether a sample that is not known lies behind a limit."""
        return self.failed_at is not None and self.failed_at > limit

    def settled(self, now: int, number: int) -> bool:
        """Whether the window is empty; one that counts samples is no more, once it had one."""
        if self.clock == SAMPLES:
            return self.taken == 0
        limit = self.position(now, number) - self.width
        return not self.fails(limit) and (self.head == len(self.places) or self.places[-1] <= limit)

    def next_change(self, after: int, _asked: Asked) -> int | None:
        """When the next sample leaves."""
        if self.clock != TIME:
            return None
        return least(self.next_leaving(after), self.next_mending(after))

    def next_leaving(self, after: int) -> int | None:
        """When the next known sample leaves."""
        index = bisect_right(self.places, after - self.width, self.head)
        return self.places[index] + self.width if index < len(self.places) else None

    def next_mending(self, after: int) -> int | None:
        """When the last sample leaves that is not known."""
        limit = after - self.width
        return self.failed_at + self.width if self.failed_at is not None and self.failed_at > limit else None

    def snapshot(self) -> Any:
        """The window as plain data."""
        return [self.taken, self.failed_at, self.short, self.last, *(column[self.head :] for column in self.columns)]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self.taken, self.failed_at, self.short, self.last, *columns = data
        for column, saved in zip(self.columns, columns, strict=True):
            column[:] = saved
        self.head = 0
        self.budget.used += len(self.places)

    def unleave(self, head: int) -> None:
        """Take `leave` back."""
        self.budget.used += self.head - head
        self.head = head

    def _take_or_fail(self, at: int, sample: Value) -> None:
        """Add a sample that is not known, or for which there may be no room."""
        self.move(at - self.width)
        if sample is FAILED or self.budget.used >= MAX_SAMPLES:
            self._fail(at, short=sample is not FAILED)
        else:
            self.add(at, sample)

    def _fail(self, at: int, *, short: bool) -> None:
        if self.journal.entries is not None:
            self.journal.entries.append(partial(self._unfail, self.failed_at, self.short))
        self.failed_at, self.short = at, short

    def _untake(self, taken: int, last: int) -> None:
        self.taken, self.last = taken, last

    def _unadd(self) -> None:
        for column in self.columns:
            column.pop()
        self.budget.used -= 1

    def _unfail(self, failed_at: int | None, short: bool) -> None:
        self.failed_at, self.short = failed_at, short

    def _untrim(self, removed: list[list[Any]]) -> None:
        for column, begin in zip(self.columns, removed, strict=True):
            column[:0] = begin
        self.head = len(removed[0])


def least(*times: int | None) -> int | None:
    """The earliest of some times, None where there is none."""
    return min((t for t in times if t is not None), default=None)
