"""Times without an oracle: what passed and was denied meanwhile is counted, and told once."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Callable, Optional


@dataclass
class Tally:
    """Events that passed, and that were denied."""

    passed: int = 0
    denied: int = 0

    def __str__(self) -> str:
        return f"{self.passed} passed and {self.denied} denied"


class Outages:
    """One begins with the first event that gets no decision, and ends when the oracle is heard."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.total = Tally()
        """Over all outages."""
        self._clock = clock
        self._now = Tally()
        self._since: Optional[float] = None

    @property
    def lasting(self) -> bool:
        """Whether there is one now."""
        return self._since is not None

    def undecided(self, *, passed: bool) -> bool:
        """Count an event that got no decision; true where an outage begins with it."""
        for tally in (self._now, self.total):
            tally.passed += passed
            tally.denied += not passed
        begins = self._since is None
        if begins:
            self._since = self._clock()
        return begins

    def over(self) -> Optional[str]:
        """The oracle decides or is attached anew; what is to be said where that ends an outage."""
        if self._since is None:
            return None
        seconds, tally = self._clock() - self._since, self._now
        self._since, self._now = None, Tally()
        return f"the oracle is back after {seconds:.1f} s, in which {tally} without it"
