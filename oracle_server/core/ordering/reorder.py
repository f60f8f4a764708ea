"""The reorder buffer: events in, in the order of arrival; events out, in the order of publication.

Each publisher's messages arrive in the order of publication, so its newest stamp is a frontier: nothing older will
still come from it. An event leaves once the frontiers of all open streams have reached its stamp, or once it has
waited `max_delay`, or when the buffer is full. What Algorithm 1 of ROSMonitoring 2.0 has released by some arrival, this
has too, in the same order.
"""

from __future__ import annotations

import heapq
import sys
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Generic, TypeVar

import msgspec

from oracle_server.core.events import Released as Why
from oracle_server.core.events import Source, StreamKey
from oracle_server.core.ordering.frontiers import Frontiers
from oracle_server.core.ordering.waits import MOST_TOLD, Waits

T = TypeVar("T")


class Released(msgspec.Struct, Generic[T], frozen=True, gc=False):
    """An item whose turn has come, and why; `late` is older than one before it, `waited` what it waited for last."""

    item: T
    why: Why
    late: bool = False
    waited: tuple[Source, ...] = ()

    @property
    def forced(self) -> bool:
        """Whether it left because the buffer was full."""
        return self.why == "capacity"


class ReorderBuffer(Generic[T]):
    """Holds items until their turn. All times are integer nanoseconds; every method returns what it releases."""

    def __init__(self, max_delay: int | None, capacity: int) -> None:
        """Hold items for `max_delay` at most, None for as long as it takes, and `capacity` items at most."""
        self._max_delay = max_delay
        self._capacity = capacity
        self._frontiers = Frontiers()
        self._heap: list[tuple[int, int]] = []
        self._held: dict[int, T] = {}
        self._deadlines: deque[tuple[int, int, int]] = deque()
        self._arrivals = 0
        self._waits = Waits()
        self._expired = (-1, -1)
        """The stamp and arrival of the newest item that has waited `max_delay`: it is due, and all that is older."""
        self.most = sys.maxsize
        """How many items that are due are released at once; the others by `more`."""
        self.present: int | None = None
        """The stamp of the newest item released; what is older comes late."""

    def __len__(self) -> int:
        return len(self._held)

    @property
    def awaited(self) -> Source | None:
        """The open stream that the order waits for, None where it waits for none."""
        return self._frontiers.slowest if self._held and self.due is None else None

    @property
    def limit(self) -> int | None:
        """The time before which no open stream has any more events; None while that is not known, or none is open."""
        return self._frontiers.limit

    @property
    def due(self) -> int | None:
        """The stamp of an item whose turn has come, and that was not released with others; None for none."""
        if not self._heap:
            return None
        first = self._heap[0]
        limit = self._frontiers.limit
        reached = first[0] <= limit if limit is not None else not self._frontiers
        return first[0] if reached or first <= self._expired else None

    @property
    def first(self) -> int | None:
        """The stamp of the oldest item held, None while nothing is."""
        return self._heap[0][0] if self._heap else None

    @property
    def next_deadline(self) -> int | None:
        """When `advance` will next release something, None while nothing is held under a bound."""
        while self._deadlines and self._deadlines[0][2] not in self._held:
            self._deadlines.popleft()
        return self._deadlines[0][0] if self._deadlines else None

    @property
    def frontiers(self) -> dict[Source, int | None]:
        """Each open stream's frontier, None before its first event or clock."""
        return {frontier.source: frontier.reached for frontier in self._frontiers}

    @property
    def sources(self) -> Iterable[Source]:
        """The open streams; not to be kept."""
        return self._frontiers.sources

    def frontier(self, source: Source) -> int | None:
        """A stream's frontier, None before its first event or clock, and where it is not open."""
        known = self._frontiers.get(source)
        return None if known is None else known.reached

    def publishers(self, source: Source) -> tuple[int, int]:
        """How many publishers of a stream are told apart, and how often one was forgotten; (0, 0) if it is not open."""
        known = self._frontiers.get(source)
        return (0, 0) if known is None else (len(known.publishers), known.forgotten)

    def heard(self, stream: StreamKey, most: int) -> list[tuple[str, Iterable[str]]]:
        """Some monitors that have a stream open, each with the publishers that it has heard; not to be kept."""
        known = self._frontiers.of_stream(stream).items()
        return [(monitor, frontier.publishers) for monitor, frontier in islice(known, most)]

    def is_ahead(self, monitor: str) -> bool:
        """Whether the order waits for none of a monitor's streams: all are beyond the least frontier."""
        return not self._frontiers.is_at_limit(monitor)

    @property
    def changes(self) -> int:
        """Grows whenever a monitor that was ahead may not be so any more."""
        return self._frontiers.changes

    @property
    def behind(self) -> set[str]:
        """The monitors that are not ahead, of those that have an open stream."""
        return self._frontiers.at_limit()

    @property
    def held(self) -> Iterable[T]:
        """What is held, in the order of arrival."""
        return self._held.values()

    def open(self, monitor: str, streams: Iterable[StreamKey]) -> list[Released[T]]:
        """Wait for these streams of a monitor from now on, and for no others of it."""
        wanted = dict.fromkeys((monitor, stream) for stream in streams)
        left = [source for source in self._frontiers.of(monitor) if source not in wanted]
        behind = [(source, self._frontiers.close(source)) for source in left]
        for source in wanted:
            self._frontiers.open(source)
        self._frontiers.find()
        self._waits.over(behind, self._reach, self._arrivals, held=bool(self._heap))
        return self._release()

    def close(self, monitor: str) -> list[Released[T]]:
        """Stop waiting for a monitor's streams; what it sent stays."""
        return self.open(monitor, ())

    def push(self, item: T, source: Source, publisher: str, stamp: int, now: int) -> list[Released[T]]:
        """Take an item that arrived now; returned at once where it is late."""
        frontier = self._frontiers.get(source)
        opened = frontier is not None
        if frontier is None:
            frontier = self._frontiers.open(source)
        known = frontier.publishers.get(publisher)
        if known is None or stamp > known:
            before = frontier.reached if opened else stamp  # nothing has waited for one that was not open
            self._frontiers.observe(frontier, publisher, stamp)
            self._moved([(source, before)], new=known is None)
        if self.present is not None and stamp < self.present:
            return [Released(item, self._why(stamp), late=True), *self._release()]
        if not self._heap and (limit := self._frontiers.limit) is not None and stamp <= limit:
            self.present = stamp
            return [Released(item, self._why(stamp))]
        self._arrivals += 1
        heapq.heappush(self._heap, (stamp, self._arrivals))
        self._held[self._arrivals] = item
        if self._max_delay is not None:
            self._deadlines.append((now + self._max_delay, stamp, self._arrivals))
        released = self._release()
        while len(self._held) > self._capacity:
            released.append(self._pop("capacity"))
        return released

    def put_back(self, item: T, source: Source, publisher: str, stamp: int, now: int) -> list[Released[T]]:
        """Take an item that was held before; of a stream that is not open any more nothing else is waited for."""
        opened = self._frontiers.get(source) is not None
        released = self.push(item, source, publisher, stamp, now)
        if not opened:
            behind = [(source, self._frontiers.close(source))]
            self._frontiers.find()
            self._waits.over(behind, self._reach, self._arrivals, held=bool(self._heap))
            released += self._release()
        return released

    def clock(self, *told: tuple[Source, int]) -> list[Released[T]]:
        """Record that nothing older than a stamp will come from each of these streams, as far as they are open.

        They are told at once: an event that waited for several of them has waited for all of these.
        """
        before = []
        for source, stamp in told:
            frontier = self._frontiers.get(source)
            if frontier is not None and (frontier.clock is None or stamp > frontier.clock):
                before.append((source, frontier.reached))
                frontier.advance(stamp)
        if not before:
            return []
        self._moved(before)
        return self._release()

    def advance(self, now: int) -> list[Released[T]]:
        """Release what has waited `max_delay`, and all that is older."""
        while self._deadlines and self._deadlines[0][0] <= now:
            self._expired = max(self._expired, self._deadlines.popleft()[1:])
        return self._release()

    def more(self) -> list[Released[T]]:
        """Release what is due and was not released with others."""
        return self._release()

    def expire(self) -> None:
        """Let all that is held be due."""
        if self._heap:
            self._expired = max(self._expired, *self._heap)

    def flush(self) -> list[Released[T]]:
        """Release everything, in order."""
        return [self._pop() for _ in range(len(self._heap))]

    def unheard(self, stamp: int) -> frozenset[str]:
        """The names of the open streams that may have something older than a stamp still, as far as they told."""
        limit = self._frontiers.limit
        return frozenset() if limit is not None and limit >= stamp else self._frontiers.names_behind(stamp)

    def _why(self, stamp: int) -> Why:
        """Why something with this stamp may leave now."""
        if not self._frontiers:
            return "frontier"
        limit = self._frontiers.limit
        if limit is None or limit < stamp:
            return "max_delay"
        return "clock" if self._frontiers.is_told(stamp) else "frontier"

    def _release(self) -> list[Released[T]]:
        released: list[Released[T]] = []
        while self.due is not None and len(released) < self.most:
            released.append(self._pop())
        return released

    def _pop(self, why: Why | None = None) -> Released[T]:
        stamp, arrival = heapq.heappop(self._heap)
        self.present = stamp
        why = why or self._why(stamp)
        if why in ("frontier", "clock"):
            waited = self._waits.of(stamp, arrival) if self._waits else ()
        else:
            waited = tuple(sorted(self._frontiers.furthest_behind(stamp, MOST_TOLD)))
        return Released(self._held.pop(arrival), why, waited=waited)

    @property
    def _reach(self) -> int:
        """The time up to which nothing waits for any stream."""
        if not self._frontiers:
            return sys.maxsize
        return -1 if self._frontiers.limit is None else self._frontiers.limit

    def _moved(self, before: Sequence[tuple[Source, int | None]], *, new: bool = False) -> None:
        """A frontier rises unless a new publisher lowers it, so that the least one changes only where it moved."""
        slowest = self._frontiers.slowest
        if new or any(source == slowest for source, _ in before):
            self._frontiers.find()
            if self._heap or self._waits:
                self._waits.over(before, self._reach, self._arrivals, held=bool(self._heap))
