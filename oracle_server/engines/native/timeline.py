"""The timeline that the nodes of one engine share, the journal by which a step is taken back, and what a step costs."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec

from oracle_server.core.engine import MAX_WORK, MAX_WORK_ON_AVERAGE, MAX_WORK_TOGETHER
from oracle_server.core.errors import EngineError
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native.keys import Key
from oracle_server.engines.native.nodes import Absent

_TRIM = 1024
FEW = 16
"""Keys that nodes look at without counting them."""
MAX_APART = 200_000
"""Keys of several variables, which multiply, that a node may distinguish: each takes some 500 bytes."""


class Undo(msgspec.Struct, frozen=True):
    """What takes a change back: a call with one argument, in half the memory of a `partial`. A horizon has many."""

    call: Callable[[Any], object]
    argument: Any

    def __call__(self) -> None:
        """Take the change back."""
        self.call(self.argument)


class Frame(msgspec.Struct, gc=False):
    """How an engine stood after so many steps; in a journal it stands before what was changed since.

    `first`, `work` and `debt` are the timeline's, `current` is where each atom held, None where none did.
    """

    steps: int
    due: int
    last: Outcome
    first: bool
    work: int
    debt: int
    current: list[Key | Absent] | None


Journal = list[Callable[[], object] | Frame]
"""What takes back each change, and how the engine stood in between, the last one last."""


class Timeline:
    """A step's time is its number or, where `timed`, nanoseconds; steps are then any time apart, or none.

    `now` is the present step's time, `before` that of the step before it; `first`: it is the first step.
    """

    __slots__ = (
        "_at_once", "_horizon", "_on_average", "_times", "allowed", "before", "counted", "debt", "first", "journal",
        "now", "reached", "timed", "work",
    )  # fmt: skip

    def __init__(self, *, timed: bool, share: float = 1) -> None:
        """`share` of what an engine may cost is what this one may."""
        self.now = self.before = 0
        self.first = True
        self.timed = timed
        self._at_once, self._on_average = int(MAX_WORK * share), int(MAX_WORK_ON_AVERAGE * share)
        self.allowed = MAX_WORK
        """Keys that may be looked at with this step, as others have looked at some."""
        self.work = 0
        """Keys that were looked at with this step, but for those of nodes that looked at few."""
        self.debt = 0
        """What earlier steps cost more than may be on average."""
        self.journal: Journal | None = None
        """None where none is kept."""
        self.counted: Timeline | None = None
        """The times at which the steps count for what was asked by `always`; None where these are their own."""
        self.reached = 0
        """The next one counts at no time before this there."""
        self._times: list[int] = []
        self._horizon: int | None = None

    def keep(self, distance: int) -> None:
        """Remember the times of steps up to this far back, for `any_between`."""
        self._horizon = max(self._horizon or 0, distance)

    def move(self, time: int) -> None:
        """Go on to the next step; see `place`."""
        if self.work or self.debt:
            self.debt, self.work = self._owed, 0
        self.before, self.now = self.now, time
        if self._horizon is not None:
            self._times.append(time)
            if len(self._times) % _TRIM == 0 and self.journal is None:
                del self._times[: bisect_left(self._times, time - self._horizon)]
        if self.counted is not None:
            self.counted.follow(self, max(time, self.reached))

    def follow(self, line: Timeline, time: int) -> None:
        """Go on to the next step with another timeline, with which that is taken back."""
        self.journal = line.journal
        if self.journal is not None:
            self.journal.append(partial(self.place, self.now, self.before, 1))
        self.move(time)

    def place(self, time: int, before: int, steps: int) -> None:
        """Go back to a step at a time, whose last one was at `before`, by so many steps."""
        self.before, self.now = before, time
        if self._horizon is not None and steps:
            del self._times[-steps:]

    def trim(self, time: int) -> None:
        """Forget what no window can reach from a time on."""
        if self._horizon is not None:
            del self._times[: bisect_left(self._times, time - self._horizon)]

    def spend(self, keys: int) -> None:
        """Count keys that a node looks at. Raises `EngineError` where a step, or all of them, cost too much."""
        work = self.work + keys
        if work + self.debt > self._at_once:
            raise EngineError(
                f"its steps cost too much: {self._at_once} combinations of values may be looked at for one step, "
                f"and {self._on_average} on average"
            )
        if work > self.allowed:
            raise EngineError(
                f"the spec's properties cost too much together: {MAX_WORK_TOGETHER} combinations of values may be "
                "looked at for one step of all of them"
            )
        self.work = work

    def run_out(self, count: int) -> None:
        """Bound what time alone decides at once, beside what steps cost. Raises `EngineError` where it is too much."""
        if count > self._at_once:
            raise EngineError(f"its deadlines cost too much: {self._at_once} obligations may run out at once")

    def tell_apart(self, keys: int) -> None:
        """Count keys of several variables that a node distinguishes. Raises `EngineError` where they are too many."""
        if keys > MAX_APART:
            raise EngineError(f"more than {MAX_APART} combinations of values would have to be distinguished")

    @property
    def _owed(self) -> int:
        return max(0, self.debt + self.work - self._on_average)

    def any_between(self, nearest: int, farthest: int) -> bool:
        """Whether there was a step at a distance from `nearest` to `farthest`."""
        place = bisect_left(self._times, self.now - farthest)
        return place < len(self._times) and self._times[place] <= self.now - nearest

    def latest(self, until: int) -> int:
        """The time of the last step up to a time; there is one that is remembered."""
        return self._times[bisect_right(self._times, until) - 1]

    def next_change(self, nearest: int, farthest: int, after: int) -> int | None:
        """The first time later than `after` at which, without a further step, `any_between` turns."""
        times = self._times
        # of steps that are all in the window, none leaves it before the next one has come in
        begin = max(bisect_left(times, after - farthest), bisect_right(times, after - nearest) - 1)
        for place in range(begin, len(times)):
            entering = times[place] + nearest
            if entering > after:
                return entering
            leaving = times[place] + farthest + 1
            if leaving > after and (place + 1 == len(times) or times[place + 1] + nearest > leaving):
                return leaving
        return None

    def snapshot(self) -> Any:
        """The timeline as plain data."""
        counted = [] if self.counted is None else [self.counted.snapshot()]
        return [self.now, self.before, self.first, self._times, self._owed, *counted]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self.now, self.before, self.first, self._times, *more = data
        self.debt, self.work = (more[0] if more else 0), 0
        if self.counted is not None:
            self.counted.restore(more[1])
