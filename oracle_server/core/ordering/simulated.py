"""Simulated time, as the clocks of a session's monitors report it."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from operator import itemgetter

from oracle_server.core.events import StreamKey
from oracle_server.core.spec import StreamSpec

_LATEST = 2**63 - 1
"""As late as a time can be."""
_TOLD_APART = 256


@dataclass(frozen=True, slots=True)
class ClockReading:
    """A monitor's promise that nothing older than `stamp` (ns) will come from one of its streams."""

    stream: StreamKey
    stamp: int


class SimulatedTime:
    """The time of a simulation (ns): the newest that a clock has reported, plus the latency that it left out."""

    def __init__(
        self, streams: Mapping[StreamKey, StreamSpec], kept: int = 0, max_skew: int = 0, now: int | None = None
    ) -> None:
        """Start without a time, or at that of before a restart; `streams` are those that clocks may report.

        When the clock reached a time is known for `kept` nanoseconds; times may differ by `max_skew` (ns).
        """
        self.now = now
        self.is_told = False
        """Whether a clock has told the time since the server was started."""
        self._streams, self._kept, self._max_skew = streams, kept, max_skew
        self._newest = 0
        self._reached_now = 0
        self._past: deque[tuple[int, int]] = deque()
        """Earlier times of the simulation, each behind the server's time at which it was reached."""

    def update(self, readings: Iterable[ClockReading], server: int) -> None:
        """Take the readings of a monitor's clock, at a time (ns) of the server."""
        for reading in readings:
            self.is_told = True
            now = min(reading.stamp + self._streams[reading.stream].held_back, _LATEST)
            if self.now is None or now > self.now:
                self._advance(now, server)

    def at(self, server: int) -> int | None:
        """The simulation's time (ns) at a time of the server, or an earlier one; None where it is not known."""
        if self.now is not None and self._reached_now <= server:
            return self.now
        i = bisect_right(self._past, server, key=itemgetter(0))
        return self._past[i - 1][1] if i else None

    def reached(self, time: int) -> int | None:
        """When (ns), by the server's time, the simulation had reached a time; None where it has not."""
        if self.now is None or time > self.now:
            return None
        i = bisect_left(self._past, time, key=itemgetter(1))
        return self._past[i][0] if i < len(self._past) else self._reached_now

    def _advance(self, now: int, server: int) -> None:
        """Reach a later time; of what is kept of the past, a few times are told apart."""
        past = self._past
        if self.now is not None and (not past or server - past[-1][0] >= self._kept // _TOLD_APART):
            past.append((self._reached_now, self.now))
            while len(past) > 1 and past[1][0] <= server - self._kept:
                past.popleft()
        self.now, self._reached_now = now, server

    def arrival(self, stamp: int | None, server: int) -> int:
        """The arrival (ns) of an event with this stamp, at a time of the server; without a clock yet, the newest stamp.

        A stamp of the server's own time is none of the simulation.
        """
        if self.now is not None and self.is_told:
            return self.now
        self._newest = max(self._newest, self.now or 0)
        if stamp is not None and not self._is_of_wall(stamp, server):
            self._newest = max(self._newest, stamp)
            return max(stamp, self.now or 0)
        return self._newest

    def _is_of_wall(self, stamp: int, server: int) -> bool:
        """Whether a stamp is rather of the server's time, as far as can be told without a clock."""
        away = abs(stamp - server)
        return away <= self._max_skew if self.now is None else away < abs(stamp - self.now)
