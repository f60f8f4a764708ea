"""Traces in JSON Lines: the project's own lines, and ROSMonitoring's flat events."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from oracle_server.core.errors import NotReadError, TraceError
from oracle_server.core.events import TICKS, Event, StreamKey
from oracle_server.core.kinds import KINDS, STATUS, TICK, StepKind
from oracle_server.core.spec import Spec
from oracle_server.core.stamps import Stamp, stamp_fault, stamp_in
from oracle_server.core.units import counted
from oracle_server.replay.doubts.pauses import Pauses
from oracle_server.replay.recording import Note, Recorded
from oracle_server.replay.traces.attempts import Attempts
from oracle_server.replay.traces.line import MAX_LINE, Found, Line, ends_early, read_line
from oracle_server.replay.traces.numbered import Numbers
from oracle_server.replay.traces.positions import Positions
from oracle_server.replay.traces.times import Times
from oracle_server.wire.flat import find_stream

Lines = Callable[[], Iterable[tuple[str, bytes]]]
"""Reads all lines from the start, each with its place for error messages."""


@dataclass(slots=True)
class Trace:
    """The events of a file, in the order of arrival, for one spec.

    `clocked` is whether the trace has times of arrival, as its first event has or has not; without them, the newest
    stamp so far is an event's time of arrival. `ignored` counts the events of streams that the spec does not observe,
    and `passed_over` are the positions of those that a session has judged;
    `read` of `size` bytes are read. `since` and `until` are when (ns) the first line and the last event arrived, of
    whatever stream.
    """

    path: Path
    spec: Spec
    lines: Lines
    size: int
    clocked: bool = True
    ignored: Counter[str] = field(default_factory=Counter)
    passed_over: Positions = field(default_factory=Positions)
    notes: list[Note] = field(default_factory=list)
    read: int = 0
    since: int = 0
    until: int = 0
    lost: int = 0
    _now: int = 0
    _seq: Counter[str] = field(default_factory=Counter)
    _odd: Counter[tuple[str, StepKind]] = field(default_factory=Counter)
    """Events of the spec's names, which has them of another kind."""
    _lost: int = 0
    _back: list[str] = field(default_factory=list)  # where simulated time went back
    _numbers: Numbers = field(default_factory=Numbers)
    _pauses: Pauses = field(default_factory=Pauses)
    _names: frozenset[str] = field(init=False)
    _times: Times = field(init=False)
    _attempts: Attempts = field(init=False)

    def __post_init__(self) -> None:
        self._names = frozenset(f"/{name.strip('/')}" for name in self.spec.names)
        self._times, self._attempts = Times(self.spec.ordering.max_skew), Attempts(self.spec)

    def __iter__(self) -> Iterator[Recorded]:
        """The events. Raises `TraceError` with file and line at the first line that is not an event."""
        first, begun = True, None
        try:
            self._attempts.survey(self._readable)
            for place, text in self.lines():
                self.read += len(text)
                if not text.strip():
                    continue
                if not first and _is_cut(text, self.read, self.size):
                    self.notes.append(Note(f"{place}: ends early, within a line", doubt=True))
                    break
                line, fault, misspelt = self._line(text, place)
                if misspelt:
                    self._times.note(place, misspelt, "what it says does not count")
                if first:
                    self.clocked, first, begun = line.arrived is not None, False, line.begun
                    self._times.clocked = self.clocked
                    self.since = (line.arrived or 0) if self.clocked and line.kind != TICK else 0
                if self.clocked and line.kind != TICK:
                    self._go_on(line)
                if line.back:
                    self._back.append(place)
                self._numbers.take(line, place)
                taken = self._attempts.take(line)
                event = None if taken.name is None else self._event(line, taken.name, place, fault)
                if event is not None:
                    event = msgspec.structs.replace(event, ask=True) if taken.asks and not event.ask else event
                    yield Recorded(event, tuple(line.places), taken.passed, line.why, line.verdict, begun, place)
                else:
                    self.passed_over.update(judged.position for judged in line.places)
        except OSError as error:
            raise NotReadError(f"{self.path}: can't be read: {error.strerror}") from None
        self.notes += self._ending()

    def _go_on(self, line: Line) -> None:
        """Note when a line arrived."""
        self.until = max(self.until, line.arrived or 0)
        if not line.places:  # while a session went on its deadlines did, too
            self._pauses.look(self.until)

    def _line(self, text: bytes, place: str) -> Found:
        try:
            return read_line(text)
        except ValueError as error:
            raise TraceError(f"{place}: not an event: {error}") from None

    def _readable(self) -> Iterator[Line]:
        """The lines of a log that is no session's trace, as far as they can be read."""
        for _, text in self.lines():
            try:
                line = read_line(text).line if text.strip() else None
            except ValueError:
                return  # it is told of when it is read
            if line is not None and line.places:
                return
            if line is not None:
                yield line

    def _event(self, line: Line, name: str, place: str, fault: str) -> Event | None:
        """The event of a line on a stream of this name, None where the spec has none."""
        if line.kind == TICK:
            return Event(TICKS, "", line.seq or 0, line.stamp, line.arrived or 0, line.message(), line.source)
        key = find_stream(name, line.kind, self.spec.by_key)
        if key is None:
            self.ignored[str(StreamKey(line.stream, line.kind))] += 1
            self._odd[name, line.kind] += f"/{name.strip('/')}" in self._names
            return None
        message = line.message()
        where = self.spec.by_key[key].stamp
        published = line.stamp or stamp_in(message, where)
        if not line.places:
            self._times.look(place, line.arrived, line.stamp or line.otherwise, fault)
            if line.arrived is None and published is None and line.otherwise is None:
                self._times.timeless(message if where is None and isinstance(message, dict) else ())
        if line.data is not None and (published is None or not (where is None or where.plain)):
            self._look_inside(line, place, where)
        stamp = published or line.otherwise
        self._pauses.published(stamp)
        arrived = line.arrived if self.clocked else stamp
        self._now = max(self._now, arrived or 0)
        self._lost += line.lost
        self._seq[line.monitor] += 1
        seq = self._seq[line.monitor] = line.seq or self._seq[line.monitor]
        status = line.status if STATUS in KINDS[line.kind].marks else None
        return Event(
            key, line.monitor, seq, stamp, self._now, message, line.source, line.call, line.lost, line.ask, None,
            line.goal_id if KINDS[line.kind].marks else None, status, line.row,
        )  # fmt: skip

    def _ending(self) -> Iterator[Note]:
        """What is to be said of the trace as a whole."""
        self._attempts.end()
        yield from self._attempts.notes
        yield from self._times.notes(timed=any(prop.time == "seconds" for prop in self.spec.properties))
        for (name, kind), count in self._odd.items():
            if count:
                what = f"{name}: {counted(count, 'event')} of the kind `{kind}`"
                yield Note(f"{what}, and the spec has another one there", doubt=True)
        yield from self._pauses.standing(self.spec)
        yield from (Note(text) for text in self._pauses.told())
        yield from self._numbers.notes()
        if self._back:
            what = f"{self._back[0]}: simulated time went back ({counted(len(self._back), 'time')} in all)"
            yield Note(f"{what}: live a session ended there, and here all is judged as one; cut the log", doubt=True)
        if self._lost:
            yield Note(f"{counted(self._lost, 'event')} lost while it was recorded", doubt=True)

    def _look_inside(self, line: Line, place: str, where: Stamp | None) -> None:
        """Look for a time in a line's message that can't be read."""
        unread = stamp_fault(line.data, where)
        if unread:
            timed = line.stamp or line.otherwise or line.arrived
            then = "it is ordered by the time of its line" if timed else "it has no time"
            self._times.note(place, f"{line.stream}: {unread}", then)


def read_lines(path: Path, spec: Spec) -> Trace:
    """The trace of a file in JSON Lines. Raises `TraceError` where it can't be read."""

    def lines() -> Iterator[tuple[str, bytes]]:
        with path.open("rb") as file:
            for number, text in enumerate(iter(lambda: file.readline(MAX_LINE), b""), start=1):
                yield f"{path}:{number}", text

    try:
        return Trace(path, spec, lines, path.stat().st_size)
    except OSError as error:
        raise NotReadError(f"{path}: can't be read: {error.strerror}") from None


def _is_cut(text: bytes, read: int, size: int) -> bool:
    """Whether a line is the last of its file, and lacks its end."""
    return read >= size and not text.endswith(b"\n") and (not text.rstrip().endswith(b"}") or ends_early(text))
