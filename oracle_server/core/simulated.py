"""Simulated time, as the monitors of a session tell it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from oracle_server.core.events import StreamKey
from oracle_server.core.spec import StreamSpec

TimeBase = Literal["wall", "sim"]
"""Whose time a monitor's clock tells: the wall's, or a simulation's."""
_LATEST = 2**63 - 1
"""As late as a time can be."""


@dataclass(frozen=True, slots=True)
class ClockReading:
    """A monitor's word that nothing older than `stamp` (ns) will come from one of its streams."""

    stream: StreamKey
    stamp: int


class SimulatedTime:
    """The time of a simulation (ns): the newest that a clock has told, less what the clocks hold back."""

    def __init__(self, streams: Mapping[StreamKey, StreamSpec]) -> None:
        """Know nothing yet; `streams` are those that clocks are told of."""
        self.now: int | None = None
        self._streams = streams
        self._newest = 0
        self._told: dict[tuple[str, StreamKey], int] = {}

    def goes_back(self, monitor: str, readings: Iterable[ClockReading]) -> bool:
        """Whether a monitor says less of some stream than it has said before: the simulation has begun anew."""
        return any(r.stamp < self._told.get((monitor, r.stream), 0) for r in readings)

    def tell(self, monitor: str, readings: Iterable[ClockReading]) -> None:
        """Take in what a monitor's clock says."""
        for reading in readings:
            self._told[monitor, reading.stream] = reading.stamp
            told = min(reading.stamp + self._held_back(self._streams[reading.stream]), _LATEST)
            self.now = told if self.now is None else max(self.now, told)

    def arrival(self, stamp: int | None) -> int:
        """When an event of this stamp has arrived; while no clock has told the time, stamps do."""
        if self.now is not None:
            return self.now
        self._newest = max(self._newest, stamp or 0)
        return stamp or self._newest

    @staticmethod
    def _held_back(stream: StreamSpec) -> int:
        """What an adapter's clock for a stream is less than now: nothing where it stamps the messages itself."""
        return 0 if stream.traits.proxied and not stream.stamp else stream.latency
