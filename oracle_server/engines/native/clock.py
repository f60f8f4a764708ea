"""The clock that the nodes of one engine share, and the journal by which a step is taken back."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from typing import Any

_TRIM = 1024


class Clock:
    """A step's time is its number or, where `timed`, nanoseconds; steps are then any time apart, or none.

    `now` is the present step's time, `before` that of the step before it; `first` tells the first step.
    """

    __slots__ = ("_horizon", "_times", "before", "first", "journal", "now", "timed")

    def __init__(self, *, timed: bool) -> None:
        self.now = self.before = 0
        self.first = True
        self.timed = timed
        self.journal: list[Callable[[], object]] | None = None
        """What takes back each change since the journal was begun, None where none is kept."""
        self._times: list[int] = []
        self._horizon: int | None = None

    def keep(self, distance: int) -> None:
        """Remember the times of steps up to this far back, for `any_between`."""
        self._horizon = max(self._horizon or 0, distance)

    def move(self, time: int) -> None:
        """Go on to the next step."""
        if self.journal is not None:
            self.journal.append(self._back_to(self.now, self.before, first=self.first))
        self.before, self.now = self.now, time
        if self._horizon is not None:
            self._times.append(time)
            if len(self._times) % _TRIM == 0 and self.journal is None:
                del self._times[: bisect_left(self._times, time - self._horizon)]

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
        for place in range(bisect_left(times, after - farthest), len(times)):
            entering = times[place] + nearest
            if entering > after:
                return entering
            leaving = times[place] + farthest + 1
            if leaving > after and (place + 1 == len(times) or times[place + 1] + nearest > leaving):
                return leaving
        return None

    def snapshot(self) -> Any:
        """The clock as plain data."""
        return [self.now, self.before, self.first, self._times]

    def restore(self, data: Any) -> None:
        """Become what a snapshot says."""
        self.now, self.before, self.first, self._times = data

    def _back_to(self, now: int, before: int, *, first: bool) -> Callable[[], object]:
        def back() -> None:
            self.now, self.before, self.first = now, before, first
            if self._horizon is not None:
                self._times.pop()

        return back
