"""Times without an oracle: what passed and was denied meanwhile is counted, and reported once."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Callable, Optional


@dataclass
class Undecided:
    """Events that got no decision: how many passed, and how many were denied."""

    passed: int = 0
    denied: int = 0

    def __str__(self) -> str:
        return f"{self.passed} passed and {self.denied} denied"


class Outages:
    """From the first event that gets no decision until the oracle answers again."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.total = Undecided()
        """Over all outages."""
        self._clock = clock
        self._now = Undecided()
        self._since: Optional[float] = None

    @property
    def lasting(self) -> bool:
        """Whether there is one now."""
        return self._since is not None

    def undecided(self, *, passed: bool) -> bool:
        """Count an event that got no decision; true where an outage begins with it."""
        for counts in (self._now, self.total):
            counts.passed += passed
            counts.denied += not passed
        begins = self._since is None
        if begins:
            self._since = self._clock()
        return begins

    def over(self) -> Optional[str]:
        """End the outage, if there is one; returns the text to show."""
        if self._since is None:
            return None
        seconds, counts = self._clock() - self._since, self._now
        self._since, self._now = None, Undecided()
        return f"the oracle is back after {seconds:.1f} s, in which {counts} without it"
