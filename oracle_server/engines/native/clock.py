"""The clock that the nodes of one engine share: a step's time is its number, or nanoseconds."""

from __future__ import annotations

from bisect import bisect_left

_TRIM = 1024


class Clock:
    """`now` is the present step's time, `before` that of the step before it; `first` tells the first step."""

    __slots__ = ("_horizon", "_times", "before", "first", "now", "timed")

    def __init__(self, *, timed: bool) -> None:
        """`timed`: time is given in nanoseconds, and steps may be any time apart or none."""
        self.now = self.before = 0
        self.first = True
        self.timed = timed
        self._times: list[int] = []
        self._horizon: int | None = None

    def keep(self, distance: int) -> None:
        """Remember the times of steps up to this far back, for `any_between`."""
        self._horizon = max(self._horizon or 0, distance)

    def move(self, time: int) -> None:
        """Go on to the next step."""
        self.before, self.now = self.now, time
        if self._horizon is not None:
            self._times.append(time)
            if len(self._times) % _TRIM == 0:
                del self._times[: bisect_left(self._times, time - self._horizon)]

    def any_between(self, nearest: int, farthest: int) -> bool:
        """Whether there was a step at a distance from `nearest` to `farthest`."""
        place = bisect_left(self._times, self.now - farthest)
        return place < len(self._times) and self._times[place] <= self.now - nearest
