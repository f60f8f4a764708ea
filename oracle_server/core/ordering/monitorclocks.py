"""Clocks of a session's monitors: those that go back, and those that are not in step with the server's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from oracle_server.core.events import StreamKey
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.spec import SECOND, StreamSpec

WALL_MAY_DIFFER = SECOND
"""By how much (ns) wall clocks may differ, whatever the spec says: they are set right by less, often."""


class MonitorClocks:
    """What the clocks of monitors have told, and whether one of them goes back."""

    def __init__(self, streams: Mapping[StreamKey, StreamSpec], max_skew: int) -> None:
        """`streams` are those that clocks may tell of; times of different monitors may differ by `max_skew` (ns)."""
        self._held_back, self._max_skew = {key: stream.held_back for key, stream in streams.items()}, max_skew
        self._told: dict[str, dict[StreamKey, int]] = {}
        self._telling: set[str] = set()
        self._ahead: dict[str, int] = {}

    def note(self, monitor: str, readings: Sequence[ClockReading], believed: Sequence[int], now: int) -> None:
        """Note what a monitor's clock tells at a time of the server (ns), and what of that is believed.

        One that was too far ahead made nothing late, so that it may be set right.
        """
        if readings:
            self._telling.add(monitor)
            self._ahead[monitor] = self._newest(readings) - now
            self._told.setdefault(monitor, {}).update((r.stream, at) for r, at in zip(readings, believed, strict=True))

    def is_back(self, monitor: str, readings: Sequence[ClockReading], present: int | None, *, wall: bool) -> bool:
        """Whether a monitor tells an earlier time of a stream than before; a `wall` clock is set right all the time.

        So it is, too, where no monitor is there that has told the time, and the first one is behind the `present` (ns).
        """
        allowed = self._allowed if wall else 0
        told = self._told.get(monitor, {})
        if any(r.stamp < told.get(r.stream, 0) - allowed for r in readings):
            return True
        if self._telling or present is None or not readings:
            return False
        return self._newest(readings) < present - max(allowed, self._max_skew)

    def apart(self, monitor: str) -> int:
        """By how much (ns) a monitor's wall clock is ahead of the server's, or behind: 0 where both are in step."""
        ahead = self._ahead.get(monitor, 0)
        return ahead if abs(ahead) > self._allowed else 0

    def trust(self, monitor: str, *, wall: bool) -> None:
        """Note that a monitor which connects is the same process as before: it may be behind.

        One in simulated time says itself where that goes back. One by the `wall` clock may tell what it had told before
        what it sends again.
        """
        self._telling.add(monitor)
        if wall:
            self._told.pop(monitor, None)

    def leave(self, monitor: str) -> None:
        """Note that a monitor is not there any more."""
        self._telling.discard(monitor)

    @property
    def _allowed(self) -> int:
        """By how much (ns) wall clocks may differ."""
        return max(WALL_MAY_DIFFER, self._max_skew)

    def _newest(self, readings: Sequence[ClockReading]) -> int:
        """The time of a clock (ns) that has told these."""
        return max([r.stamp + self._held_back[r.stream] for r in readings])
