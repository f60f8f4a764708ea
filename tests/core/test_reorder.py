"""The reorder buffer: publication order out of any order of arrival, and nothing lost, doubled or held for ever."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import Source, StreamKey
from oracle_server.core.ordering.reorder import Released, ReorderBuffer

A, B, C = (StreamKey(name, "topic") for name in ("/a", "/b", "/c"))
SA, SB, SC = (("m", key) for key in (A, B, C))
MAX_DELAY = 10
PLENTY = 10_000

often = settings(max_examples=500, deadline=None)


@dataclass(frozen=True)
class Item:
    """Something that arrives: one of a publisher's, in the order of its stamps."""

    source: Source
    publisher: str
    stamp: int
    arrives: int


Arrivals = list[Item]


def in_order_of_stamps(items: Iterable[Item]) -> Arrivals:
    """Items as they arrive: each publisher's in the order of its stamps, for that none earlier than the one before."""
    newest: dict[tuple[Source, str], int] = {}
    kept = []
    for item in sorted(items, key=lambda i: i.stamp):
        publisher = (item.source, item.publisher)
        newest[publisher] = max(item.arrives, newest.get(publisher, 0))
        kept.append(Item(item.source, item.publisher, item.stamp, newest[publisher]))
    return sorted(kept, key=lambda i: i.arrives)


def arrivals(publishers: int, max_delay: int) -> st.SearchStrategy[Arrivals]:
    """Items of three streams that arrive at most `max_delay` after their stamps."""
    item = st.builds(
        lambda source, publisher, stamp, delay: Item(source, f"p{publisher}", stamp, stamp + delay),
        st.sampled_from((SA, SB, SC)),
        st.integers(1, publishers),
        st.integers(0, 25),
        st.integers(0, max_delay),
    )
    return st.lists(item, max_size=30).map(in_order_of_stamps)


def opened(max_delay: int | None = MAX_DELAY, capacity: int = PLENTY) -> ReorderBuffer[int]:
    buffer: ReorderBuffer[int] = ReorderBuffer(max_delay, capacity)
    buffer.open("m", (A, B, C))
    return buffer


def take(buffer: ReorderBuffer[int], item: Item, number: int) -> list[Released[int]]:
    """What a session does on an arrival."""
    before = buffer.advance(item.arrives)
    return before + buffer.push(number, item.source, item.publisher, item.stamp, item.arrives)


def items(released: Iterable[Released[int]]) -> list[int]:
    return [r.item for r in released]


@often
@given(found=arrivals(2, MAX_DELAY), clocks=st.lists(st.tuples(st.sampled_from((SA, SB, SC)), st.integers(0, 9))))
def test_delays_within_the_bound_come_out_in_publication_order(
    found: Arrivals, clocks: list[tuple[Source, int]]
) -> None:
    """With publishers that are known and clocks that are true: sorted by stamp, ties by arrival, nothing late."""
    known = [Item(source, f"p{p}", 0, 0) for source, p in product((SA, SB, SC), (1, 2))]
    found = known + found
    buffer = opened()
    released: list[Released[int]] = []
    for number, item in enumerate(found):
        released += take(buffer, item, number)
        if number < len(clocks):
            source, slack = clocks[number]
            coming = [other.stamp for other in found[number + 1 :] if other.source == source]
            released += buffer.clock((source, min(coming, default=99) - slack))
    released += buffer.flush()
    assert items(released) == sorted(range(len(found)), key=lambda n: (found[n].stamp, n))
    assert not any(r.late or r.forced for r in released)


@pytest.mark.parametrize(("max_delay", "delays"), [(None, 50), (MAX_DELAY, MAX_DELAY)])
@often
@given(data=st.data())
def test_what_algorithm_1_has_released_is_released(max_delay: int | None, delays: int, data: st.DataObject) -> None:
    found = data.draw(arrivals(1, delays))
    lists: dict[Source, list[tuple[int, int]]] = {SA: [], SB: [], SC: []}
    buffer = opened(max_delay)
    theirs: list[int] = []
    ours: list[Released[int]] = []
    for number, item in enumerate(found):
        lists[item.source].append((item.stamp, number))
        while all(lists.values()):
            earliest = min(lists.values(), key=lambda waiting: waiting[0])
            theirs.append(earliest.pop(0)[1])
        ours += take(buffer, item, number)
        assert items(ours)[: len(theirs)] == theirs
    assert not any(r.late for r in ours)


@dataclass
class Spoken:
    """What a stream has said since it was opened."""

    clock: int = -1
    publishers: dict[str, int] = field(default_factory=dict)

    @property
    def frontier(self) -> int | None:
        reached = max(min(self.publishers.values(), default=-1), self.clock)
        return None if reached == -1 else reached


@dataclass
class Watched:
    """A buffer with all that may happen to it, checked after everything that does."""

    max_delay: int | None
    capacity: int
    now: int = 0
    newest: int = -1
    pushed: int = 0
    waiting: dict[int, tuple[int, int]] = field(default_factory=dict)
    """The stamp and the arrival of each item that is held."""
    spoken: dict[Source, Spoken] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.buffer: ReorderBuffer[int] = ReorderBuffer(self.max_delay, self.capacity)

    def do(self, what: str, source: Source, publisher: str, stamp: int) -> None:
        match what:
            case "push":
                said = self.spoken.setdefault(source, Spoken()).publishers
                said[publisher] = max(stamp, said.get(publisher, 0))
                self.waiting[self.pushed] = (stamp, self.now)
                self.pushed += 1
                self.took(self.buffer.push(self.pushed - 1, source, publisher, stamp, self.now), pushing=True)
            case "clock":
                if source in self.spoken:
                    self.spoken[source].clock = max(stamp, self.spoken[source].clock)
                self.took(self.buffer.clock((source, stamp)))
            case "open":
                self.open(source[0], (source[1],) if publisher == "p1" else (A, B))
            case "close":
                self.open(source[0], ())
            case _:
                self.now += stamp
                self.took(self.buffer.advance(self.now), by_deadline=True)
                deadlines = [since + self.max_delay for _, since in self.waiting.values() if self.max_delay is not None]
                assert all(deadline > self.now for deadline in deadlines)
                assert self.buffer.next_deadline == min(deadlines, default=None)

    def open(self, monitor: str, streams: tuple[StreamKey, ...]) -> None:
        wanted = {(monitor, stream): Spoken() for stream in streams}
        stay = {s: said for s, said in self.spoken.items() if s[0] != monitor or s in wanted}
        self.spoken = wanted | stay
        self.took(self.buffer.open(monitor, streams) if streams else self.buffer.close(monitor))

    def took(self, released: list[Released[int]], *, pushing: bool = False, by_deadline: bool = False) -> None:
        frontiers = {source: said.frontier for source, said in self.spoken.items()}
        reached = min((-1 if f is None else f for f in frontiers.values()), default=PLENTY)
        for r in released:
            stamp, _ = self.waiting.pop(r.item)  # fails for what was released before
            assert r.late == (stamp < self.newest)
            assert not r.late or (pushing and r.item == self.pushed - 1), "what is held can't become late"
            assert stamp <= reached or r.late or r.forced or by_deadline, "left before its time"
            assert not r.forced or (pushing and len(self.buffer) == self.capacity)
            self.newest = max(self.newest, stamp)
        assert self.buffer.frontiers == frontiers
        assert all(stamp > reached for stamp, _ in self.waiting.values()), "waits in vain"
        assert len(self.buffer) == len(self.waiting) <= self.capacity
        assert list(self.buffer.held) == list(self.waiting)


@settings(often, max_examples=3_000)
@given(
    max_delay=st.none() | st.integers(0, 12),
    capacity=st.integers(1, 6) | st.just(PLENTY),
    happenings=st.lists(
        st.tuples(
            st.sampled_from(("push", "push", "push", "clock", "open", "close", "advance")),
            st.sampled_from(list(product(("m", "n"), (A, B)))),
            st.sampled_from(("p1", "p2", "p3")),
            st.integers(0, 12),
        ),
        max_size=50,
    ),
)
def test_whatever_happens(max_delay: int | None, capacity: int, happenings: list[tuple[str, Source, str, int]]) -> None:
    """Every item comes out once, in order but for what is marked late, in time, and within capacity."""
    watched = Watched(max_delay, capacity)
    for happening in happenings:
        watched.do(*happening)
    watched.took(watched.buffer.flush(), by_deadline=True)
    assert not watched.waiting
    assert watched.buffer.next_deadline is None
