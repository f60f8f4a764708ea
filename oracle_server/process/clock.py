"""The server's clock: the wall clock's time, but it never goes back and never stands still."""

from __future__ import annotations

import time
from collections import deque
from typing import NamedTuple

import structlog

MAX_AHEAD = 3600 * 10**9
"""Nanoseconds by which a clock may be ahead of the wall clock and wait for it, or begin ahead of it."""
MAX_APART = 10**9
"""Nanoseconds by which it may be ahead and be the clock of what begins, whose stamps are the wall clock's; and by which
the wall clock may be set back while this one goes on, and it waits for that."""

_REMEMBERED = 100
"""Leaps that are remembered."""

log = structlog.get_logger()


class _Leap(NamedTuple):
    """From when to when the wall clock was set ahead (ns): what it leapt over did not pass."""

    before: int
    after: int


class Clock:
    """Follows the wall clock; where that is set back by a little, continues at half speed until the two are equal.

    So timeouts expire and arrivals keep their order, whatever happens to the machine's time. Where the wall clock is
    set back by more than `MAX_APART`, one of its times is wrong: this clock goes on at full speed from where it is, and
    says so. One that begins ahead, by `MAX_AHEAD` at most, goes on at half speed; further ahead a new server's begins
    at the wall clock's time. A session that has lived later goes on by a clock of its own, and one that begins while
    this one is ahead begins by the wall clock.
    """

    def __init__(self, at_least: int = 0) -> None:
        """Start at the wall clock's time, and not before `at_least` (ns since the epoch) unless that is too far."""
        wall = time.time_ns()
        if at_least - wall > MAX_AHEAD:
            log.warning("the wall clock was set back since the last start", seconds=(at_least - wall) // 10**9)
            at_least = 0
        self._now = max(at_least, wall)
        self._wall = wall
        self._ticks = time.monotonic_ns()
        self._far = False
        self._slept = _slept()
        self._leaps = deque[_Leap](maxlen=_REMEMBERED)

    def now(self) -> int:
        """The time in nanoseconds since the epoch; never less than before."""
        ticks, wall = time.monotonic_ns(), time.time_ns()
        passed = ticks - self._ticks
        if not self._far and (back := self._wall + passed - wall) > MAX_APART:
            self._far = True
            log.warning("the wall clock was set back: the server's time goes on until a restart", seconds=back // 10**9)
        if (skipped := wall - self._now - passed) > MAX_APART:
            what = "the wall clock was set ahead, or the machine slept: deadlines of meanwhile run out at once"
            log.warning(what, seconds=skipped // 10**9)
            self._leap(self._now + passed, wall)
        self._now = max(self._now + (passed if self._far else passed // 2), wall)
        self._ticks, self._wall = ticks, wall
        self._far = self._far and self._now > wall
        return self._now

    def ago(self, age: int) -> int:
        """What this clock told so long ago (ns): of what it leapt over as it was set ahead nothing has passed."""
        found = self.now() - age
        for before, after in reversed(self._leaps):
            if found >= after:
                break
            found = min(before, found - (after - before))
        return found

    def since(self, time_: int) -> Clock:
        """The clock for what has lived until `time_` (0: it begins): itself, or one of its own.

        That is where `time_` is ahead of this one, or this one of the wall clock; it goes on from the later of these.
        """
        if time_ <= self.now() and self.ahead <= MAX_APART:
            return self
        own = Clock()
        own._now = max(own._now, time_)
        own._far = own.ahead > MAX_AHEAD
        return own

    @property
    def ahead(self) -> int:
        """By how much it is ahead of the wall clock (ns)."""
        return max(0, self._now - time.time_ns())

    @property
    def far(self) -> bool:
        """Whether it is ahead of the wall clock, and does not wait for it."""
        return self._far

    def _leap(self, before: int, after: int) -> None:
        slept = _slept()
        before, self._slept = before + slept - self._slept, slept
        if after - before > MAX_APART:
            self._leaps.append(_Leap(before, after))


def _slept() -> int:
    """How long the machine has slept, and something that stays the same (ns); 0 where no clock tells it."""
    kind = getattr(time, "CLOCK_BOOTTIME", None)
    return 0 if kind is None else time.clock_gettime_ns(kind) - time.monotonic_ns()
