"""Stamps in another unit than the spec says: their time passes a thousand times slower or faster than arrivals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.spec import SECOND, Spec
from oracle_server.core.stamps import Stamp, since_boot_in
from oracle_server.replay.recording import Recorded
from oracle_server.replay.traces.times import unit_of

_MOST = 64
"""The samples of one publisher that are kept."""
_PARTS = 4
"""The parts of a recording in each of which stamps must be as slow or fast: a pause or a jump is in one of them."""
_LEAST = _PARTS
"""The fewest samples that tell anything."""
_UNITS = {"ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds", "s": "seconds"}
_NAMES = tuple(_UNITS.values())
_Sample = tuple[int, int]
"""A stamp, and when it was first seen (ns)."""


@dataclass(slots=True)
class _Samples:
    """Stamps of one publisher over the whole recording, of which every `stride`-th is kept."""

    kept: list[_Sample] = field(default_factory=list)
    in_log: bool = False
    latest: int | None = None
    stride: int = 1
    seen: int = 0

    def add(self, stamp: int, arrived: int) -> None:
        """Note a stamp, unless it is that of the message before: of data that is sent again the first one counts."""
        if stamp == self.latest:
            return
        self.latest = stamp
        if self.seen % self.stride == 0:
            self.kept.append((stamp, arrived))
        self.seen += 1
        if len(self.kept) == _MOST:
            self.kept, self.stride = self.kept[::2], self.stride * 2

    def thousands(self) -> int:
        """How often arrivals must be divided by 1,000 to span what stamps do; 0 where they are alike, or that varies.

        It is negative where stamps are faster. Only 1,000, 1,000,000 and so on are other units: replayed or simulated
        time may pass at any rate.
        """
        if len(self.kept) < _LEAST or self.kept[-1][1] - self.kept[0][1] < SECOND:
            return 0
        last = len(self.kept) - 1
        parts = min(_PARTS, last)
        ends = [self.kept[last * i // parts] for i in range(parts + 1)]
        found = {_thousands(*pair) for pair in itertools.pairwise(ends)}
        found.add(_thousands(ends[0], ends[-1]))
        return found.pop() if len(found) == 1 else 0

    @property
    def spans(self) -> tuple[int, int]:
        """What the stamps span, and the arrivals (ns)."""
        (stamp, arrived), (last_stamp, last_arrived) = self.kept[0], self.kept[-1]
        return abs(last_stamp - stamp), last_arrived - arrived


def _thousands(one: _Sample, other: _Sample) -> int:
    """The power of 1,000 by which arrivals span more than stamps, within a factor of 2; 0 for none."""
    stamps, arrivals = abs(other[0] - one[0]), other[1] - one[1]
    if not stamps or arrivals <= 0:
        return 0
    power = math.log(arrivals / stamps, 1000)
    return round(power) if abs(power - round(power)) < math.log(2, 1000) else 0


class Units:
    """Compares the time that passes in the stamps of each stream with that between arrivals."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen."""
        self._stamps = {stream.key: stream.stamp for stream in spec.streams}
        self._samples: dict[tuple[StreamKey, str, str], _Samples] = {}

    def look(self, recorded: Recorded) -> None:
        """Look at an event that has a time of arrival."""
        event = recorded.event
        stamp = _stamp_of(event, self._stamps[event.stream])
        if stamp is not None:
            key = event.stream, event.monitor, event.source
            samples = self._samples.get(key)
            if samples is None:
                samples = self._samples[key] = _Samples(in_log=bool(recorded.place))
            samples.add(stamp, event.arrived)

    def doubts(self) -> Iterator[str]:
        """What is to be said of the streams whose stamps are in another unit, a line each."""
        told = set()
        for (stream, _, _), samples in self._samples.items():
            where, thousands = self._stamps[stream], samples.thousands()
            if thousands and where is None and samples.in_log and unit_of(*samples.kept[-1]):
                continue  # it is said with its line
            if thousands and stream not in told:
                told.add(stream)
                yield _said(stream, where, thousands, samples.spans)


def _stamp_of(event: Event, where: Stamp | None) -> int | None:
    """The time that stands in an event, in the spec's unit, as nanoseconds since whatever it counts from."""
    if where is not None and not where.plain:
        return since_boot_in(event.data, where) or event.stamp
    return event.stamp


def _said(stream: StreamKey, where: Stamp | None, thousands: int, spans: tuple[int, int]) -> str:
    stamps, arrivals = (f"{span / SECOND:.6g} s" for span in spans)
    what = f"{stream}: its stamps span {stamps}, and its arrivals {arrivals}"
    if where is None:
        return f"{what}: they are in another unit"
    taken = _NAMES.index(_UNITS[where.unit or "s"])
    meant = taken + thousands
    if 0 <= meant < len(_NAMES):
        return f"{what}: `{where.field}` looks like {_NAMES[meant]}, and is taken for {_NAMES[taken]}"
    return f"{what}: `{where.field}` is in another unit than {_NAMES[taken]}"
