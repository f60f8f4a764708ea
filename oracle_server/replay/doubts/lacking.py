"""Messages of a log that lack what the spec reads of them, though each message of their type has it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

from oracle_server.core.events import StreamKey
from oracle_server.core.plan import Plan
from oracle_server.core.shapes import Record
from oracle_server.core.typed import StreamTypes
from oracle_server.replay.doubts.coverage import signal_names
from oracle_server.replay.doubts.misfit import TIMES
from oracle_server.replay.recording import Recorded

_Path = tuple[str, ...]


class Lacking:
    """Looks for fields that are read, and missing; a field that is there and null is not, nor what stands in lists."""

    def __init__(self, ready: Plan, types: StreamTypes) -> None:
        """Begin with nothing seen; only streams whose types are known are looked at."""
        self._ready = ready
        self._signals = {key: frozenset(signal_names(ready.spec, key)) for key in types}
        self._types = {key: type_.surest.name for key, type_ in types.items()}
        self._paths = {
            key: sorted(filter(None, {_sure(type_.surest, path.split(".")) for path in _read(ready, key)}))
            for key, type_ in types.items()
        }
        self._count: Counter[StreamKey] = Counter()
        self._first: dict[StreamKey, str] = {}

    def look(self, recorded: Recorded) -> None:
        """Look at a message that stands somewhere in a log."""
        stream, data = recorded.event.stream, recorded.event.data
        paths = self._paths.get(stream)
        if not (paths and recorded.place and isinstance(data, Mapping)):
            return
        for path in paths:
            missing = _missing(data, path)
            if missing:
                if not self._has_all_signals(stream, data):
                    self._note(recorded, missing)
                return

    def _note(self, recorded: Recorded, missing: str) -> None:
        stream = recorded.event.stream
        self._count[stream] += 1
        what = f"{recorded.place}: {stream}: it has no `{missing}`, which each {self._types[stream]} has"
        self._first.setdefault(stream, what)

    def _has_all_signals(self, stream: StreamKey, data: Mapping[str, object]) -> bool:
        """Whether a message has all signals none the less, as where expressions ask by `has(…)` what is there."""
        project = self._ready.streams[stream].project
        return all(self._signals[stream] <= signals.keys() for signals, _ in project.rows(data) or [project(data)])

    def doubts(self) -> Iterator[str]:
        """What is to be said of each stream, a line each."""
        for stream, first in self._first.items():
            such = f" ({self._count[stream]} such lines)" if self._count[stream] > 1 else ""
            yield f"{first}: what reads it is absent there{such}"


def _read(ready: Plan, key: StreamKey) -> frozenset[str]:
    """The dotted paths of the fields that a stream's signals read, as far as they can be told."""
    stream = ready.streams.get(key)
    return (stream.project.fields if stream else None) or frozenset()


def _sure(shape: Record, path: list[str]) -> _Path:
    """The part of a path that each message of a type has; a time is there as a whole, however it is written."""
    inner, found = shape, 0
    for name in path:
        of = inner.fields.get(name)
        if of is None or inner.name in TIMES:
            break
        found += 1
        if not isinstance(of, Record):
            break
        inner = of
    return tuple(path[:found])


def _missing(message: Mapping[str, object], path: _Path) -> str:
    """The first field of a path that is missing, with its own path; empty where all are there, or one is no message."""
    value: object = message
    for depth, name in enumerate(path, start=1):
        if type(value) is not dict:
            return ""
        if name not in value:
            return ".".join(path[:depth])
        value = value[name]
    return ""
