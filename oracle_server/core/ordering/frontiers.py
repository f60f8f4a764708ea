"""How far each open stream of each monitor has come, and which of them is furthest behind."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from oracle_server.core.events import Source, StreamKey
from oracle_server.core.ordering.least import Least

MAX_PUBLISHERS = 1_000
"""The most publishers of one stream that are told apart; beyond, the one that is furthest behind is not waited for."""
_UNKNOWN = -(2**63)


@dataclass(slots=True, eq=False)
class Frontier:
    """What is known of one stream of one monitor: its clock and the newest stamp of each of its publishers.

    `least` is a heap with an entry for each publisher, whose stamp is its newest one or an older one: only the first
    entry has to be true, and `observe` leaves it so where there are several.
    """

    source: Source
    number: int
    clock: int | None = None
    publishers: dict[str, int] = field(default_factory=dict)
    least: list[tuple[int, str]] = field(default_factory=list)
    forgotten: int = 0
    reached: int | None = None
    """The time before which nothing can come from here any more; None while nothing is known."""
    closed: bool = False

    def observe(self, publisher: str, stamp: int) -> None:
        """Record a publisher's newest stamp."""
        if publisher not in self.publishers:
            if len(self.publishers) == MAX_PUBLISHERS:
                self.forget()
            heapq.heappush(self.least, (stamp, publisher))
        self.publishers[publisher] = stamp
        least = stamp if len(self.publishers) == 1 else self._first()
        self.reached = least if self.clock is None or least > self.clock else self.clock

    def forget(self) -> None:
        """Wait no more for the publisher that is furthest behind; it is a new one where it speaks again."""
        del self.publishers[heapq.heappop(self.least)[1]]
        self.forgotten += 1

    def advance(self, clock: int) -> None:
        """Record a newer clock."""
        self.clock = clock
        if self.reached is None or clock > self.reached:
            self.reached = clock

    def shown(self) -> int:
        """The time before which nothing more can come as far as messages tell, without a clock."""
        return self._first() if self.publishers else _UNKNOWN

    def _first(self) -> int:
        """The least of the newest stamps."""
        while (newest := self.publishers[self.least[0][1]]) != self.least[0][0]:
            heapq.heapreplace(self.least, (newest, self.least[0][1]))
        return self.least[0][0]


class Frontiers:
    """The frontiers of the open streams. Nothing looks at all of them but where all of them are asked for."""

    def __init__(self) -> None:
        """Begin with no open stream."""
        self.slowest: Source | None = None
        """The stream that is furthest behind, of several the one that was opened first; None where none is open."""
        self.limit: int | None = None
        """The time before which no open stream has any more events; None while that is not known, or none is open."""
        self.changes = 0
        """Grows whenever `at_limit` may tell of a monitor of which it did not tell before."""
        self._known: dict[Source, Frontier] = {}
        self._of: dict[str, dict[Source, Frontier]] = {}
        self._of_stream: dict[StreamKey, dict[str, Frontier]] = {}
        self._reached, self._shown = Least(_reached), Least(_shown)
        self._by_name: dict[str, Least[Frontier]] | None = None
        """By the names of the streams, once that is asked for: only what revises does."""
        self._numbers = itertools.count()

    def __bool__(self) -> bool:
        return bool(self._known)

    def __iter__(self) -> Iterator[Frontier]:
        return iter(self._known.values())

    @property
    def sources(self) -> Iterable[Source]:
        """The open streams."""
        return self._known.keys()

    def get(self, source: Source) -> Frontier | None:
        """The frontier of a stream, None where it is not open."""
        return self._known.get(source)

    def of(self, monitor: str) -> Iterable[Source]:
        """The open streams of a monitor."""
        return self._of.get(monitor, ())

    def of_stream(self, stream: StreamKey) -> Mapping[str, Frontier]:
        """The frontiers of a stream, by the monitors that have it open."""
        return self._of_stream.get(stream, {})

    def open(self, source: Source) -> Frontier:
        """Open a stream, unless it is open; `find` is to be called then."""
        frontier = self._known.get(source)
        if frontier is None:
            frontier = self._known[source] = Frontier(source, next(self._numbers))
            self._of.setdefault(source[0], {})[source] = frontier
            self._of_stream.setdefault(source[1], {})[source[0]] = frontier
            self._add(frontier)
        return frontier

    def close(self, source: Source) -> int | None:
        """Close an open stream, and return where it was; `find` is to be called then."""
        frontier = self._known.pop(source)
        frontier.closed = True
        own = self._of[source[0]]
        del own[source]
        if not own:
            del self._of[source[0]]
        del self._of_stream[source[1]][source[0]]
        return frontier.reached

    def observe(self, frontier: Frontier, publisher: str, stamp: int) -> None:
        """Record a newer stamp of a publisher; `find` is to be called where it is a new one, or of the slowest."""
        lowers = publisher not in frontier.publishers and stamp < frontier.shown()
        frontier.observe(publisher, stamp)
        if lowers:
            self.changes += 1
            self._add(frontier)

    def find(self) -> None:
        """Find the slowest one, and the limit."""
        first, before = self._reached.first(), self.limit
        self.slowest = None if first is None else first[1].source
        self.limit = None if first is None else first[1].reached
        self.changes += self.limit != before

    def is_told(self, stamp: int) -> bool:
        """Where nothing older than a stamp will come: whether only a clock tells so of any stream, and not messages."""
        first = self._shown.first()
        return first is not None and first[0] < stamp

    def furthest_behind(self, stamp: int, most: int) -> list[Source]:
        """The streams that may have something older than a stamp still; of many the furthest behind."""
        return [frontier.source for frontier in self._reached.below(stamp, most)]

    def names_behind(self, stamp: int) -> frozenset[str]:
        """The names of all streams that may have something older than a stamp still."""
        if self._by_name is None:
            self._by_name = {}
            for frontier in self:
                self._add_by_name(self._by_name, frontier)
        firsts = ((name, least.first()) for name, least in self._by_name.items())
        return frozenset(name for name, first in firsts if first is not None and first[0] < stamp)

    def is_at_limit(self, monitor: str) -> bool:
        """Whether a monitor has a stream that is as far behind as any, or no open one."""
        own = self._of.get(monitor)
        return own is None or any(frontier.reached == self.limit for frontier in own.values())

    def at_limit(self) -> set[str]:
        """The monitors that have such a stream."""
        bound = (_UNKNOWN if self.limit is None else self.limit) + 1
        return {frontier.source[0] for frontier in self._reached.below(bound)}

    def _add(self, frontier: Frontier) -> None:
        self._reached.add(frontier)
        self._shown.add(frontier)
        if self._by_name is not None:
            self._add_by_name(self._by_name, frontier)

    @staticmethod
    def _add_by_name(by_name: dict[str, Least[Frontier]], frontier: Frontier) -> None:
        name = frontier.source[1].name
        least = by_name.get(name)
        if least is None:
            least = by_name[name] = Least(_reached)
        least.add(frontier)


def _reached(frontier: Frontier) -> int | None:
    if frontier.closed:
        return None
    return _UNKNOWN if frontier.reached is None else frontier.reached


def _shown(frontier: Frontier) -> int | None:
    return None if frontier.closed else frontier.shown()
