"""Recorded traces in JSON Lines: the project's own lines, and ROSMonitoring's flat ones."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from oracle_server.core.errors import TraceError
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.spec import Spec
from oracle_server.core.stamps import nanoseconds, stamp_in

Nanoseconds = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Count = Annotated[int, Meta(ge=0, le=2**63 - 1)]
MAX_LINE = 64 * 2**20


class Line(Struct):
    """A line of the project's own kind; `arrived` and `stamp` in nanoseconds since the epoch."""

    stream: str
    data: dict[str, Any]
    kind: Literal["topic", "request", "response"] = "topic"
    stamp: Nanoseconds | None = None
    arrived: Nanoseconds | None = None
    monitor: str = "replay"
    seq: Count | None = None
    source: str = ""
    call: Count | None = None
    lost: Count = 0
    ask: bool = False


@dataclass(slots=True)
class Trace:
    """The events of a file, in the order of arrival, for one spec.

    `clocked` tells whether the trace says when its events arrived, which its first event decides; without, every
    event counts as arrived with the newest stamp so far. `ignored` counts the events of streams that the spec
    does not observe, `read` the bytes that were read.
    """

    path: Path
    spec: Spec
    clocked: bool = True
    ignored: Counter[str] = field(default_factory=Counter)
    read: int = 0
    _now: int = 0
    _seq: Counter[str] = field(default_factory=Counter)

    def __iter__(self) -> Iterator[Event]:
        """The events. Raises `TraceError` with file and line at the first line that is none."""
        first = True
        try:
            with self.path.open("rb") as file:
                for number, text in enumerate(iter(lambda: file.readline(MAX_LINE), b""), start=1):
                    self.read += len(text)
                    if not text.strip():
                        continue
                    line = self._line(text, number)
                    if first:
                        self.clocked, first = line.arrived is not None, False
                    event = self._event(line)
                    if event is not None:
                        yield event
        except OSError as error:
            raise TraceError(f"{self.path}: can't be read: {error.strerror}") from None

    def _line(self, text: bytes, number: int) -> Line:
        try:
            value = _decode(text)
            return msgspec.convert(value if "stream" in value else _unflattened(value), Line)
        except (msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
            reason = "nested too deep" if isinstance(error, RecursionError) else error
            raise TraceError(f"{self.path}:{number}: not an event: {reason}") from None

    def _event(self, line: Line) -> Event | None:
        key = _stream(line, self.spec)
        if key is None:
            self.ignored[line.stream] += 1
            return None
        stamp = line.stamp or stamp_in(line.data, self.spec.by_key[key].stamp)
        arrived = line.arrived if self.clocked else stamp
        self._now = max(self._now, arrived or 0)
        self._seq[line.monitor] += 1
        seq = self._seq[line.monitor] = line.seq or self._seq[line.monitor]
        return Event(key, line.monitor, seq, stamp, self._now, line.data, line.source, line.call, line.lost, line.ask)


def _decode(text: bytes) -> Mapping[str, Any]:
    try:
        value = msgspec.json.decode(text)
    except msgspec.DecodeError:
        # old monitors write NaN and infinities bare; they become the strings that the wire has for them
        value = json.loads(text, parse_constant=str)
    if not isinstance(value, dict):
        raise TypeError("expected a JSON object")
    return value


def _unflattened(value: Mapping[str, Any]) -> dict[str, Any]:
    """ROSMonitoring's flat event as a line: what stands beside `topic` and `time` is the message."""
    arrived = nanoseconds(value.get("time", value.get("t")))
    line: dict[str, Any] = {"arrived": arrived}
    if isinstance(value.get("topic"), str):
        data = {k: v for k, v in value.items() if k not in ("topic", "time")}
        return line | {
            "stream": value["topic"],
            "kind": "topic",
            "stamp": stamp_in(data, None) or arrived,
            "data": data,
        }
    kind = next((k for k in ("response", "request") if k in value), None)
    if kind and isinstance(value.get("service"), str):
        stamp = nanoseconds(value.get("stamp")) or arrived
        return line | {"stream": value["service"], "kind": kind, "stamp": stamp, "data": value[kind]}
    raise ValueError("it has neither `stream`, nor `topic`, nor `service` with a `request` or `response`")


def _stream(line: Line, spec: Spec) -> StreamKey | None:
    """The stream of the spec that a line speaks of; old monitors may leave the leading slash out."""
    bare = line.stream.removeprefix("/")
    for name in (line.stream, f"/{bare}", bare):
        key = StreamKey(name, line.kind)
        if key in spec.by_key:
            return key
    return None
