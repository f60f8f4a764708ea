"""Events that came too late for their place in the order or for a deadline, or with stamps too far ahead: how many."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from oracle_server.core.events import StreamKey
from oracle_server.core.kinds import TICK
from oracle_server.core.spec import SECOND, Spec
from oracle_server.core.verdicts import Judged
from oracle_server.replay.doubts.aged import FAR, Aged
from oracle_server.replay.recording import Note, part_of

_HANDFUL = 5
"""So many events of a stream that are not in their place are no matter, however few events it has."""

_LATE = "late, up to", "behind what was judged before"
_SKEWED = "skewed, up to", "ahead of the arrival, and ordered by that"
_OVERTAKEN = "older than a deadline that was judged before: up to", "between stamp and arrival"
_SIMULATED = (
    "; where the stamps are in a simulation's time, and those of the recording are not, `--by arrival` judges by the "
    "recording's alone; `ros2 bag record --use-sim-time` has both in the simulation's"
)
DAY = 86_400 * SECOND
"""For so long no message is on its way: then one of the two clocks is another one, as in a simulation."""


@dataclass(slots=True)
class _Displaced:
    """How many events of each stream are not in their place, and by how much the furthest one (ns)."""

    count: Counter[StreamKey] = field(default_factory=Counter)
    most: dict[StreamKey, int] = field(default_factory=dict)

    def add(self, stream: StreamKey, by: int) -> None:
        self.count[stream] += 1
        self.most[stream] = max(self.most.get(stream, 0), by)


class Delays:
    """Counts late and skewed events in the order of publication; streams that are not ordered have none."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing judged."""
        self._ordered = {stream.key for stream in spec.streams if stream.ordered}
        self._stamps = {s.key: s.stamp for s in spec.streams if s.stamp and s.stamp.unit and s.stamp.epoch == "unix"}
        self._events: Counter[StreamKey] = Counter()
        self._late, self._placed, self._skewed, self._overtaken = (_Displaced() for _ in range(4))
        self._present = self._deadline = 0
        self._aged = Aged()

    def note(self, judged: Judged) -> None:
        """Note a judged step."""
        step, stream = judged.step, judged.step.event.stream
        if judged.order != "publication":
            return
        if stream.kind == TICK:
            self._deadline = max(self._deadline, step.time)
            return
        if stream not in self._ordered or step.event.row:
            return
        self._events[stream] += 1
        if step.skewed:
            self._skewed.add(stream, step.stamp - step.event.arrived)
        if step.late:
            found = self._late if judged.place is None else self._placed
            found.add(stream, self._present - step.time)
        else:
            self._aged.look(judged)
            if step.time < self._deadline:
                self._overtaken.add(stream, step.event.arrived - step.time)
        self._present = max(self._present, step.time)

    def notes(self, *, clocked: bool = True) -> Iterator[Note]:
        """What is to be said of each stream; a doubt where most of its events are not in their place, or are far.

        `clocked` is whether the recording has times of arrival.
        """
        told = {stream for found in (self._late, self._placed) for stream, by in found.most.items() if by > FAR}
        yield from self._aged.notes(self._events, told) if clocked else ()
        for stream, events in self._events.items():
            for found, before, after in (
                (self._late, *_LATE), (self._skewed, *_SKEWED), (self._overtaken, *_OVERTAKEN),
            ):  # fmt: skip
                count = found.count[stream]
                if count:
                    by = f"{found.most[stream] / SECOND:.6g} s"
                    text = f"{stream}: {part_of(count, events)} {before} {by} {after}"
                    text += self._own_time(stream, found) if found.most[stream] > DAY else ""
                    many = _HANDFUL if found.most[stream] > FAR else max(_HANDFUL, events // 2)
                    yield Note(text, doubt=count > many)
            count = self._placed.count[stream]
            if count:
                most = self._placed.most[stream]  # 0 where only a deadline was judged before
                by = f", up to {most / SECOND:.6g} s {_LATE[1]}" if most else ""
                yield Note(f"{stream}: {part_of(count, events)} late{by}; what was said without that was put right")

    def _own_time(self, stream: StreamKey, found: _Displaced) -> str:
        """What to do where a stream's stamps and its arrivals are those of two clocks."""
        if stream in self._stamps and found is not self._skewed:
            where = self._stamps[stream].field
            return f"; where `{where}` counts since the robot's start, as PX4's do, its `stamp` takes `epoch: boot`"
        return "" if found is self._skewed else _SIMULATED
