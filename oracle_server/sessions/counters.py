"""What a server has counted since it started: plain numbers, so that counting costs next to nothing."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain

from oracle_server.core.tally import HoldTimes
from oracle_server.core.verdicts import Outcome

_US = 1_000
TIMES = tuple(
    us * _US
    for us in (100, 250, 500, 1_000, 2_500, 5_000, 10_000, 25_000, 50_000, 100_000, 250_000, 500_000, 1_000_000)
)
"""Upper ends of the buckets of a time (ns); one more takes what is longer."""


class Times:
    """A histogram of times."""

    def __init__(self) -> None:
        self.buckets = [0] * (len(TIMES) + 1)
        self.total = 0

    def add(self, time: int) -> None:
        """Count a time (ns)."""
        self.buckets[bisect_left(TIMES, time)] += 1
        self.total += time


class Counters:
    """One server's numbers. What sessions count themselves is added up when it is asked for."""

    def __init__(self) -> None:
        self.outcomes: Counter[Outcome] = Counter(dict.fromkeys(Outcome, 0))
        """Verdicts, by their outcome."""
        self.steps = 0
        self.decisions = Times()
        """From an event's arrival to its decision's leaving."""
        self.throttled = 0
        """Times that a monitor was kept waiting."""
        self.opened = 0
        """Connections of monitors that were accepted."""
        self._past: Counter[str] = Counter()
        self._held = HoldTimes()

    def judged(self, steps: Sequence[Sequence[Outcome]]) -> None:
        """Count steps as they go to the history: the outcomes of each."""
        self.steps += len(steps)
        self.outcomes.update(chain.from_iterable(steps))

    def restored(self, counts: Counter[str]) -> None:
        """Leave out what a session had counted before this server started."""
        self._past.subtract(counts)

    def closed(self, counts: Counter[str], holds: HoldTimes) -> None:
        """Keep what a session has counted."""
        self._past.update(counts)
        _add(self._held, holds)

    def summed(self, counts: Iterable[Counter[str]]) -> Counter[str]:
        """What all sessions have counted: the open ones, whose `counts` are given, and those that were."""
        summed = Counter(self._past)
        for one in counts:
            summed.update(one)
        return summed

    def held(self, holds: Iterable[HoldTimes]) -> HoldTimes:
        """How long events were held in the order: in the open sessions, whose `holds` these are, and closed ones."""
        summed = HoldTimes(list(self._held.buckets), self._held.total)
        for one in holds:
            _add(summed, one)
        return summed


def _add(times: HoldTimes, more: HoldTimes) -> None:
    times.buckets[:] = [a + b for a, b in zip(times.buckets, more.buckets, strict=True)]
    times.total += more.total
