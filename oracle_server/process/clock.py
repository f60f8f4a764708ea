"""The server's clock: the wall clock's time, but it never goes back and never stands still."""

from __future__ import annotations

import time


class Clock:
    """Follows the wall clock; where that is set back, continues at half speed until the two are equal.

    So timeouts expire and arrivals keep their order, whatever happens to the machine's time.
    """

    def __init__(self, at_least: int = 0) -> None:
        """Start at the wall clock's time, and not before `at_least` (ns since the epoch)."""
        self._now = max(at_least, time.time_ns())
        self._ticks = time.monotonic_ns()

    def now(self) -> int:
        """The time in nanoseconds since the epoch; never less than before."""
        ticks = time.monotonic_ns()
        self._now = max(self._now + (ticks - self._ticks) // 2, time.time_ns())
        self._ticks = ticks
        return self._now
