"""What a server has counted since it started: plain numbers, so that counting costs next to nothing."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from oracle_server.core.tally import HoldTimes
from oracle_server.history.sqlite.schema import OUTCOMES, STEP_COLUMNS, Row

if TYPE_CHECKING:
    from oracle_server.sessions.live import LiveSession

_OUTCOMES = STEP_COLUMNS.index("outcomes")
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


class Tally:
    """One server's numbers. What sessions count themselves is added up when it is asked for."""

    def __init__(self) -> None:
        self.outcomes = dict.fromkeys(OUTCOMES, 0)
        """Verdicts, by the letter of their outcome."""
        self.steps = 0
        self.decisions = Times()
        """From an event's arrival to its decision's leaving."""
        self.throttled = 0
        """Times that a monitor was kept waiting."""
        self.opened = 0
        """Connections of monitors that were accepted."""
        self._past: Counter[str] = Counter()
        self._held = HoldTimes()

    def judged(self, rows: Sequence[Row]) -> None:
        """Count steps as they go to the history."""
        self.steps += len(rows)
        letters = "".join([row[_OUTCOMES] for row in rows])
        for letter in self.outcomes:
            self.outcomes[letter] += letters.count(letter)

    def restored(self, session: LiveSession) -> None:
        """Leave out what a session had counted before this server started."""
        self._past.subtract(counts(session))

    def closed(self, session: LiveSession) -> None:
        """Keep what a session has counted."""
        self._past.update(counts(session))
        _add(self._held, session)

    def counters(self, sessions: Sequence[LiveSession]) -> Counter[str]:
        """What all sessions have counted, those that are open and those that were."""
        summed = Counter(self._past)
        for session in sessions:
            summed.update(counts(session))
        return summed

    def held(self, sessions: Sequence[LiveSession]) -> HoldTimes:
        """How long events were held in the order, over all sessions."""
        summed = HoldTimes(list(self._held.buckets), self._held.total)
        for session in sessions:
            _add(summed, session)
        return summed


def counts(session: LiveSession) -> Counter[str]:
    """What one session has counted in the order that decides."""
    judge = next(iter(session.core.judges.values()))
    found = Counter({name: getattr(judge.counters, name) for name in ("late", "skewed", "skipped", "lost", "denied")})
    found["duplicates"] = sum(count.duplicates for count in session.core.counts.values())
    found["refused"] = session.ledger.refused
    found["violations"] = sum(p.violations for p in judge.properties)
    found["engine_failures"] = sum(p.broken is not None for j in session.core.judges.values() for p in j.properties)
    return found


def _add(times: HoldTimes, session: LiveSession) -> None:
    own = session.core.holds
    times.buckets[:] = [a + b for a, b in zip(times.buckets, own.buckets, strict=True)]
    times.total += own.total
