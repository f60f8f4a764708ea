"""The rate limit of one monitor: an average, so that a monitor may send at once what it queued while disconnected."""

from __future__ import annotations

import time

_BURST = 2.0
"""Seconds' worth of events that may come at once."""
_AT_ONCE = 64
"""Events of one connection that are processed before it yields to the others."""
_TURN = 0.0005
"""Seconds after which it yields in any case: a formula may be slow."""


class Throttle:
    """A token bucket that fills at `rate` events a second; 0 is no limit."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._room = rate * _BURST
        self._at = self._began = time.monotonic()
        self._run = 0

    def begin(self) -> None:
        """Begin a turn: something has arrived."""
        self._began = time.monotonic()

    def count(self) -> None:
        """Count an event."""
        self._run += 1

    @property
    def must_yield(self) -> bool:
        """Whether the connection should call `pause` and yield to the others."""
        return self.is_full or (self._run > 0 and time.monotonic() - self._began > _TURN)

    @property
    def is_full(self) -> bool:
        """Whether `_AT_ONCE` events were counted since the last `pause`."""
        return self._run >= _AT_ONCE

    def pause(self) -> float:
        """Settle the events counted since the last call; returns for how many seconds nothing should be read."""
        counted, self._run = self._run, 0
        now = time.monotonic()
        passed, self._at = now - self._at, now
        self._began = now
        if not self._rate:
            return 0.0
        self._room = min(self._rate * _BURST, self._room + passed * self._rate) - counted
        return max(0.0, -self._room / self._rate)
