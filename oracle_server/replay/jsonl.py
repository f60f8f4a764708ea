"""Traces in JSON Lines: the project's own lines, and ROSMonitoring's flat events."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from oracle_server.core.errors import TraceError
from oracle_server.core.events import TICKS, Event
from oracle_server.core.kinds import TICK, StepKind
from oracle_server.core.spec import Spec
from oracle_server.core.stamps import stamp_in
from oracle_server.replay.recording import Note, Place, Projected, Recorded
from oracle_server.wire.flat import decode_object, find_stream, flat_event

Natural = Annotated[int, Meta(ge=0, le=2**63 - 1)]
MAX_LINE = 64 * 2**20
"""The most bytes of one line."""


class Line(Struct):
    """A line in the project's own format; times in nanoseconds since the epoch.

    It has the message as `data`, or its signals as `signals` and `failed`. `otherwise` is the publication time of a
    message that has none itself. `places`, `passed`, `why` and `verdict` are what was recorded about the event live;
    the first line of a session's trace has `begun`, when the session began.
    """

    stream: str
    data: dict[str, Any] | None = None
    signals: dict[str, str | bool | int | float] | None = None
    failed: list[str] = []
    kind: StepKind = "topic"
    stamp: Natural | None = None
    arrived: Natural | None = None
    monitor: str = "replay"
    seq: Natural | None = None
    source: str = ""
    call: Natural | None = None
    lost: Natural = 0
    ask: bool = False
    otherwise: Natural | None = None
    places: list[Place] = []
    passed: bool | None = None
    why: str | None = None
    verdict: str | None = None
    begun: Natural | None = None

    def message(self) -> dict[str, Any] | Projected:
        """The message, or its signals, to ingest. Raises ValueError where the line has neither."""
        if self.data is not None:
            return self.data
        if self.signals is None:
            raise ValueError("the field `data` is missing")
        return Projected(self.signals, frozenset(self.failed))


Lines = Callable[[], Iterable[tuple[str, bytes]]]
"""Reads all lines from the start, each with its place for error messages."""


@dataclass(slots=True)
class Trace:
    """The events of a file, in the order of arrival, for one spec.

    `clocked` is whether the trace has times of arrival, as its first event has or has not; without them, the newest
    stamp so far is an event's time of arrival. `ignored` counts the events of streams that the spec does not observe;
    `read` of `size` bytes are read.
    """

    path: Path
    spec: Spec
    lines: Lines
    size: int
    clocked: bool = True
    ignored: Counter[str] = field(default_factory=Counter)
    notes: list[Note] = field(default_factory=list)
    read: int = 0
    _now: int = 0
    _seq: Counter[str] = field(default_factory=Counter)

    def __iter__(self) -> Iterator[Recorded]:
        """The events. Raises `TraceError` with file and line at the first line that is not an event."""
        first, begun = True, None
        try:
            for place, text in self.lines():
                self.read += len(text)
                if not text.strip():
                    continue
                if not first and _is_cut(text, self.read, self.size):
                    self.notes.append(Note(f"{place}: ends early, within a line", doubt=True))
                    break
                line = self._line(text, place)
                if first:
                    self.clocked, first, begun = line.arrived is not None, False, line.begun
                event = self._event(line)
                if event is not None:
                    yield Recorded(event, tuple(line.places), line.passed, line.why, line.verdict, begun)
        except OSError as error:
            raise TraceError(f"{self.path}: can't be read: {error.strerror}") from None

    def _line(self, text: bytes, place: str) -> Line:
        try:
            line = msgspec.convert(_line_of(decode_object(text)), Line)
            line.message()
        except (msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
            reason = "nested too deep" if isinstance(error, RecursionError) else error
            raise TraceError(f"{place}: not an event: {reason}") from None
        return line

    def _event(self, line: Line) -> Event | None:
        if line.kind == TICK:
            return Event(TICKS, "", line.seq or 0, line.stamp, line.arrived or 0, line.message())
        key = find_stream(line.stream, line.kind, self.spec.by_key)
        if key is None:
            self.ignored[line.stream] += 1
            return None
        message = line.message()
        stamp = line.stamp or stamp_in(message, self.spec.by_key[key].stamp) or line.otherwise
        arrived = line.arrived if self.clocked else stamp
        self._now = max(self._now, arrived or 0)
        self._seq[line.monitor] += 1
        seq = self._seq[line.monitor] = line.seq or self._seq[line.monitor]
        return Event(key, line.monitor, seq, stamp, self._now, message, line.source, line.call, line.lost, line.ask)


def read_lines(path: Path, spec: Spec) -> Trace:
    """The trace of a file in JSON Lines. Raises `TraceError` where it can't be read."""

    def lines() -> Iterator[tuple[str, bytes]]:
        with path.open("rb") as file:
            for number, text in enumerate(iter(lambda: file.readline(MAX_LINE), b""), start=1):
                yield f"{path}:{number}", text

    try:
        return Trace(path, spec, lines, path.stat().st_size)
    except OSError as error:
        raise TraceError(f"{path}: can't be read: {error.strerror}") from None


def _is_cut(text: bytes, read: int, size: int) -> bool:
    """Whether a line is the last of its file, and lacks its end."""
    return read >= size and not text.endswith(b"\n") and not text.rstrip().endswith(b"}")


def _line_of(value: dict[str, Any]) -> Any:
    """The fields of a `Line` from a JSON object, which is one already or a flat event of ROSMonitoring's."""
    if "stream" in value:
        return value
    flat = flat_event(value)
    verdict = value.get("verdict")
    line = {"stream": flat.stream, "kind": flat.kind, "data": flat.data, "arrived": flat.time}
    return line | {"otherwise": flat.stamp or flat.time, "verdict": verdict if isinstance(verdict, str) else None}
