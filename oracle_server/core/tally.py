"""Counters of a session's order: by stream, and how long events were held."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field

_MS = 10**6
BOUNDS = tuple(ms * _MS for ms in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000))
"""Upper ends of the buckets of a hold time (ns); one more takes what is longer."""


@dataclass(slots=True)
class StreamCounts:
    """Of one stream of one monitor: events that were late, lost, or sent again."""

    late: int = 0
    lost: int = 0
    duplicates: int = 0


@dataclass(slots=True)
class HoldTimes:
    """How long events were held in the order, as a histogram (ns)."""

    buckets: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS) + 1))
    total: int = 0

    def add(self, held: int) -> None:
        """Count an event that was held so long."""
        self.buckets[bisect_left(BOUNDS, held)] += 1
        self.total += held

    @property
    def count(self) -> int:
        """How many events were held, for however short."""
        return sum(self.buckets)


@dataclass(slots=True)
class Counters:
    """What a judge has counted; `steps` are judged events, `skipped` those that were not, `ticks` the recorded ones."""

    steps: int = 0
    ticks: int = 0
    late: int = 0
    skewed: int = 0
    skipped: int = 0
    lost: int = 0
    denied: int = 0
