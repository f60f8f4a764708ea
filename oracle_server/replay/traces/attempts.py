"""What the lines of a log are for streams that pass through a monitor: what nodes asked for, and what passed."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import msgspec

from oracle_server.core.kinds import ACTION, KINDS
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.replay.bags.passing import Filter
from oracle_server.replay.bags.roles import PROXY, only_passed
from oracle_server.replay.recording import Note, passed_beside
from oracle_server.replay.traces.line import Line

_Name = tuple[str, str]
"""The group of an interface, and its name without slashes around it."""
_NOT_SENT = frozenset({"verdict", "t"})
"""What ROSMonitoring adds to a message in its log."""


@dataclass(slots=True)
class _Side:
    """One side of a stream, by its own name: what was asked for, or else what passed and is `forwarded`."""

    name: str
    filter: Filter | None = None
    asks: bool = False
    forwarded: bool = False
    open: defaultdict[tuple[str, int | None], deque[bool]] = field(default_factory=lambda: defaultdict(deque))
    """By monitor and call, whether the requests that wait for their response were denied."""


@dataclass(slots=True)
class Taken:
    """What a line is: an event of the stream `name`, None for none; whether it waited for a decision, and passed."""

    name: str | None
    asks: bool = False
    passed: bool | None = None


class Attempts:
    """Tells what lines are, once it has looked at all of them.

    Nothing is special where only the names of the spec's streams are in the log: they are what nodes asked for.
    """

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing known of the log."""
        self._streams = [stream for stream in spec.streams if stream.leads and _is_between(stream)]
        self._own = {_name(stream.traits.group, stream.name) for stream in spec.streams}
        self._sides: dict[_Name, _Side] = {}
        self._filters: list[tuple[str, Filter]] = []
        self.notes: list[Note] = []

    def survey(self, read: Callable[[], Iterable[Line]]) -> None:
        """Look at all lines of a log, which `read` reads from the start: whose side is recorded, and what passed."""
        if not self._streams:
            return
        others = {_name(stream.traits.group, _other(stream)) for stream in self._streams} - self._own
        wanted = others | {_name(stream.traits.group, stream.name) for stream in self._streams}
        counts = Counter(name for line in read() if (name := _name_of(line)) in wanted)
        for stream in self._streams:
            other = _name(stream.traits.group, _other(stream))
            if other in others and counts[other]:
                self._of_stream(stream, _name(stream.traits.group, stream.name), other, counts)
        now = 0
        for line in read() if self._filters else ():
            now = max(now, line.arrived or line.stamp or 0)
            side = self._sides.get(_name_of(line))
            if side is not None and side.filter is not None and line.kind != "response":
                (side.filter.gave if side.forwarded else side.filter.asked)(now, _content(line))
        for _, passing in self._filters:
            passing.settle()

    def take(self, line: Line) -> Taken:
        """What the next line is, by its name; with the name that the spec has for it."""
        side = self._sides.get(_name_of(line))
        if side is None:
            return Taken(line.stream, line.ask, line.passed)
        if side.forwarded:
            return Taken(None)
        waiting = side.open[line.monitor, line.call]
        if line.kind == "response":
            return Taken(None if waiting and waiting.popleft() else side.name)
        passed = side.filter.take() if side.filter is not None else None
        if line.kind == "request":
            waiting.append(passed is False)
        return Taken(side.name, side.asks, passed)

    def end(self) -> None:
        """Note what passed though nobody asked for it."""
        for name, passing in self._filters:
            if passing.others:
                self.notes.append(passed_beside(name, passing.others))

    def _of_stream(self, stream: StreamSpec, own: _Name, other: _Name, counts: Counter[_Name]) -> None:
        """Of a stream whose other name is in the log, too."""
        if stream.action != "filter":
            if not counts[own]:
                self._sides[other] = _Side(stream.name)
            return
        asked, passed = (own, other) if stream.intercept == "subscriber" else (other, own)
        if not counts[asked]:
            self._sides[passed] = _Side(stream.name)
            self.notes.append(only_passed(stream.name, f"no {stream.name}"))
            return
        passing = Filter(stream.decide_within) if counts[passed] else None
        self._sides[asked] = _Side(stream.name, passing, asks=True)
        if passing is not None:
            self._sides[passed] = _Side(stream.name, passing, forwarded=True)
            self._filters.append((stream.name, passing))


def _is_between(stream: StreamSpec) -> bool:
    """Whether a monitor stands between the nodes of a stream, so that it has two names."""
    return stream.traits.group != ACTION and (stream.action == "filter" or stream.proxied)


def _other(stream: StreamSpec) -> str:
    return stream.proxy or stream.name + PROXY


def _name(group: str, name: str) -> _Name:
    return group, name.strip("/")


def _name_of(line: Line) -> _Name:
    return _name(KINDS[line.kind].group, line.stream)


def _content(line: Line) -> bytes | None:
    if line.data is None:
        return None
    sent = {key: value for key, value in line.data.items() if key not in _NOT_SENT}
    return msgspec.json.encode(sent, order="deterministic")
