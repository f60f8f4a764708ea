"""Windows of samples: (now - width, now], in nanoseconds, in steps, or in samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Collection
from functools import partial
from typing import Any, Final, Protocol

import msgspec

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
        at = now if self.clock == TIME else number if self.clock == STEPS else self.taken + 1
        if sample is FAILED:
            self._fail(at, number, short=False)
        elif self.budget.used >= MAX_SAMPLES and self._is_full(at):
            self._fail(at, number, short=True)
        else:
            if self.journal.entries is not None:
                self.journal.entries.append(Taken(self, self.last, self.head))
            self.last = number
            if self.clock == SAMPLES:
                self.taken = at
            self.add(at, sample)
            self.pass_by(at - self.width)
        return self.value(now, number, signals, failed)

    @abstractmethod
    def value(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """What the signal is at a step."""

    def add(self, at: int, _sample: Value) -> None:
        """Put a sample into the columns; who calls this notes it."""
        self.places.append(at)
        self.budget.used += 1

    def untake(self, last: int, head: int) -> None:
        """Take the last sample back: before it, the window began at `head`."""
        self.unleave(head)
        for column in self.columns:
            column.pop()
        self.budget.used -= 1
        self.last = last
        if self.clock == SAMPLES:
            self.taken -= 1

    def move(self, limit: int) -> None:
        """Let go of what is at positions up to a limit."""
        if self.journal.entries is not None:
            self.journal.entries.append(Left(self, self.head))
        self.pass_by(limit)

    def leave(self) -> None:
        """Let go of all."""
        if self.journal.entries is not None:
            self.journal.entries.append(Left(self, self.head))
        self.begin_at(len(self.places))

    def pass_by(self, limit: int) -> None:
        """Let go of what is at positions up to a limit; who calls this notes where the window began."""
        places, head = self.places, self.head
        if head < len(places) and places[head] <= limit:
            head += 1  # as most often
            if head < len(places) and places[head] <= limit:
                head = bisect_right(places, limit, head)
            self.begin_at(head)

    def begin_at(self, head: int) -> None:
        """Let the window begin further on; who calls this notes where it began."""
        self.budget.used -= head - self.head
        self.head = head
        if head >= _TRIM and 2 * head > len(self.places):
            if self.journal.entries is not None:
                self.journal.entries.append(partial(self._untrim, [column[:head] for column in self.columns]))
            for column in self.columns:
                del column[:head]
            self.head = 0

    def unleave(self, head: int) -> None:
        """Let the window begin where it began."""
        self.budget.used += self.head - head
        self.head = head

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

    def _is_full(self, at: int) -> bool:
        """Whether there is no room for a sample at a position, once those have left that may."""
        self.move(at - self.width)
        return self.budget.used >= MAX_SAMPLES

    def _fail(self, at: int, number: int, *, short: bool) -> None:
        """Note a sample that is not known, or for which there was no room."""
        if self.journal.entries is not None:
            self.journal.entries.append(partial(self._unfail, self.taken, self.last, self.failed_at, self.short))
        self.failed_at, self.short, self.last = at, short, number
        if self.clock == SAMPLES:
            self.taken = at

    def _unfail(self, taken: int, last: int, failed_at: int | None, short: bool) -> None:
        self.taken, self.last, self.failed_at, self.short = taken, last, failed_at, short

    def _untrim(self, removed: list[list[Any]]) -> None:
        for column, begin in zip(self.columns, removed, strict=True):
            column[:0] = begin
        self.head = len(removed[0])


class Left(msgspec.Struct, frozen=True, gc=False):
    """Lets a window begin where it began, at `head`."""

    window: Window
    head: int

    def __call__(self) -> None:
        """Take back that samples have left."""
        self.window.unleave(self.head)


class Taken(msgspec.Struct, frozen=True, gc=False):
    """Takes back the last sample of a window, and that others have left with it."""

    window: Window
    last: int
    head: int

    def __call__(self) -> None:
        """Take the sample back."""
        self.window.untake(self.last, self.head)


def least(*times: int | None) -> int | None:
    """The earliest of some times, None where there is none."""
    return min((t for t in times if t is not None), default=None)
