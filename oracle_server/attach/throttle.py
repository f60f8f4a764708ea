"""How fast one monitor may be heard: an average over a while, so that what it kept back while away may come at once."""

from __future__ import annotations

import time

_BURST = 2.0
"""Seconds of events that may come at once."""
_AT_ONCE = 64
"""Events of one connection before the others have their turn."""
_TURN = 0.005
"""Seconds after which they have it in any case: a formula may be slow."""


class Throttle:
    """A bucket that fills at `rate` events a second; 0 for any number."""

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._room = rate * _BURST
        self._at = time.monotonic()
        self._run = 0

    def count(self) -> None:
        """Count an event."""
        self._run += 1

    @property
    def is_due(self) -> bool:
        """Whether it is the others' turn."""
        return self.is_long or (self._run > 0 and time.monotonic() - self._at > _TURN)

    @property
    def is_long(self) -> bool:
        """Whether many were counted since the last `pause`."""
        return self._run >= _AT_ONCE

    def pause(self) -> float:
        """Seconds for which nothing more should be read, for what was counted since the last call."""
        counted, self._run = self._run, 0
        now = time.monotonic()
        passed, self._at = now - self._at, now
        if not self._rate:
            return 0.0
        self._room = min(self._rate * _BURST, self._room + passed * self._rate) - counted
        return max(0.0, -self._room / self._rate)
