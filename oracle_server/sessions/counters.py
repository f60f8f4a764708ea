"""What a server has counted since it started, as plain numbers; `/metrics` reads them."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain

from oracle_server.core.session import Session
from oracle_server.core.tally import HoldTimes
from oracle_server.core.verdicts import Outcome
from oracle_server.sessions.violated import Violated

_US = 1_000
DECISION_BOUNDS = tuple(
    us * _US
    for us in (100, 250, 500, 1_000, 2_500, 5_000, 10_000, 25_000, 50_000, 100_000, 250_000, 500_000, 1_000_000)
)
"""Upper bounds of the buckets of `DecisionTimes` (ns); one more bucket takes longer times."""


class DecisionTimes:
    """A histogram of the times from an event's arrival to its decision."""

    def __init__(self) -> None:
        self.buckets = [0] * (len(DECISION_BOUNDS) + 1)
        self.total = 0
        """The sum of all times (ns)."""

    def add(self, time: int) -> None:
        """Count a time (ns)."""
        self.buckets[bisect_left(DECISION_BOUNDS, time)] += 1
        self.total += time


class Counters:
    """One server's counters. Those that each session keeps itself are added up on request."""

    def __init__(self) -> None:
        self.outcomes: Counter[Outcome] = Counter(dict.fromkeys(Outcome, 0))
        """Verdicts, by their outcome."""
        self.steps = 0
        self.decisions = DecisionTimes()
        self.throttled = 0
        """Pauses of monitors that sent too fast."""
        self.violated = Violated()
        self.attachments = 0
        """Connections on which a monitor attached."""
        self.undrawn = 0
        """Steps that were not sent to Foxglove, since it was behind."""
        self._past: Counter[str] = Counter()
        self._holds = HoldTimes()

    def add_steps(self, steps: Sequence[Sequence[Outcome]]) -> None:
        """Count steps that are being written, each given by its outcomes."""
        self.steps += len(steps)
        self.outcomes.update(chain.from_iterable(steps))

    def exclude(self, counts: Counter[str]) -> None:
        """Subtract what a restored session had counted before this server started."""
        self._past.subtract(counts)

    def add_closed(self, counts: Counter[str], holds: HoldTimes) -> None:
        """Keep the counts of a session that is closed."""
        self._past.update(counts)
        _add(self._holds, holds)

    def total_counts(self, counts: Iterable[Counter[str]]) -> Counter[str]:
        """The counts of all sessions: those of the open ones, which are given, and of the closed ones."""
        total = Counter(self._past)
        for one in counts:
            total.update(one)
        return total

    def total_holds(self, holds: Iterable[HoldTimes]) -> HoldTimes:
        """How long all sessions held events: the open ones, whose `holds` are given, and the closed ones."""
        total = HoldTimes(list(self._holds.buckets), self._holds.total)
        for one in holds:
            _add(total, one)
        return total


def _add(times: HoldTimes, more: HoldTimes) -> None:
    times.buckets[:] = [a + b for a, b in zip(times.buckets, more.buckets, strict=True)]
    times.total += more.total


def counted(core: Session, refused: int) -> Counter[str]:
    """The session's counts so far, in the order that decides, by the names of the metrics. None ever falls."""
    counters = next(iter(core.judges.values())).told.counters
    names = ("late", "skewed", "skipped", "lost", "denied", "revised", "retracted")
    found = Counter({name: getattr(counters, name) for name in names})
    found["duplicates"] = sum(count.duplicates for count in core.counts.values())
    found["refused"] = refused
    found["engine_failures"] = sum(p.broken is not None for j in core.judges.values() for p in j.properties)
    return found
