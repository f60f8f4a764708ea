"""Simulated time, as the clocks of a session's monitors report it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from oracle_server.core.events import StreamKey
from oracle_server.core.spec import StreamSpec

TimeBase = Literal["wall", "sim"]
"""The time base of a monitor's clock: wall time, or the time of a simulation."""
_LATEST = 2**63 - 1
"""As late as a time can be."""


@dataclass(frozen=True, slots=True)
class ClockReading:
    """A monitor's promise that nothing older than `stamp` (ns) will come from one of its streams."""

    stream: StreamKey
    stamp: int


class SimulatedTime:
    """The time of a simulation (ns): the newest that a clock has reported, plus the latency that it left out."""

    def __init__(self, streams: Mapping[StreamKey, StreamSpec]) -> None:
        """Start without a time; `streams` are those that clocks may report."""
        self.now: int | None = None
        self._streams = streams
        self._newest = 0
        self._reported: dict[tuple[str, StreamKey], int] = {}

    def goes_back(self, monitor: str, readings: Iterable[ClockReading]) -> bool:
        """Whether a monitor reports an earlier time of a stream than before: the simulation has restarted."""
        return any(r.stamp < self._reported.get((monitor, r.stream), 0) for r in readings)

    def update(self, monitor: str, readings: Iterable[ClockReading]) -> None:
        """Take the readings of a monitor's clock."""
        for reading in readings:
            self._reported[monitor, reading.stream] = reading.stamp
            now = min(reading.stamp + self._held_back(self._streams[reading.stream]), _LATEST)
            self.now = now if self.now is None else max(self.now, now)

    def arrival(self, stamp: int | None) -> int:
        """The arrival (ns) of an event with this stamp; without a clock yet, the newest stamp."""
        if self.now is not None:
            return self.now
        self._newest = max(self._newest, stamp or 0)
        return stamp or self._newest

    @staticmethod
    def _held_back(stream: StreamSpec) -> int:
        """How far an adapter's clock for a stream is behind (ns): 0 where the adapter stamps the messages itself."""
        return 0 if stream.proxied and not stream.stamp else stream.latency
