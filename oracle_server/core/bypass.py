"""What reaches a robot past its monitors: which properties it concerns, and what people are told of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from oracle_server.core.events import StreamKey


class Bypass(NamedTuple):
    """A monitor's report that one of its streams is bypassed, in words, and since when (ns)."""

    text: str
    since: int


class Bypasses:
    """The bypassed streams of a session's monitors."""

    def __init__(self, readers: Mapping[str, frozenset[int]]) -> None:
        """`readers` are the properties, by their indexes, that guard or read a topic or service, by its name."""
        self._readers = readers
        self._known: dict[str, Mapping[StreamKey, Bypass]] = {}

    def update(self, monitor: str, streams: Mapping[StreamKey, Bypass]) -> None:
        """Take the bypassed streams of a monitor, in place of those before."""
        if streams:
            self._known[monitor] = dict(streams)
        else:
            self._known.pop(monitor, None)

    @property
    def properties(self) -> frozenset[int]:
        """The indexes of the properties that guard or read a bypassed stream."""
        return frozenset[int]().union(*(self._readers.get(key.name, ()) for m in self._known.values() for key in m))

    def of(self, index: int) -> list[Bypass]:
        """Why the verdicts of a property, by its index, may be wrong at present."""
        found = [
            bypass
            for streams in self._known.values()
            for key, bypass in streams.items()
            if index in self._readers.get(key.name, ())
        ]
        return list(dict.fromkeys(found))
