"""A monitor's numbers, however disordered, are counted as by the simple form, which looks through all that it has."""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from oracle_server.core.ordering.numbering import JUDGED, Numbering

Happening = tuple[str, int, int]


class Simple:
    """Takes and uses up numbers; what it looks for it looks for everywhere."""

    def __init__(self, saved: Any = None) -> None:
        upto, lost, done = saved or (0, 0, [])
        self.upto: int = upto
        self._lost: int = lost
        self._newest: int = upto
        self._done = [(first, last, size) for first, last, size in done]
        self._taken = {last for _, last, _ in self._done}
        self._gaps: dict[int, int] = {}
        self._inside: set[int] = set()

    @property
    def next(self) -> int:
        return self._newest + 1

    def saved(self) -> Any:
        return [self.upto, self._lost, sorted(self._done)]

    def hold(self, seq: int) -> None:
        self._taken.add(seq)

    def resume(self) -> None:
        self._newest = self.upto

    def restart(self) -> None:
        self._newest = max(self.upto, *self._taken) if self._taken else self.upto

    def take(self, seq: int) -> int | None:
        before, self._newest = self._newest, max(self._newest, seq)
        if seq <= self.upto or seq in self._taken:
            return None
        gap = max(0, seq - 1 - before)
        gap -= sum(1 for other in self._taken if before < other < seq)
        if gap > 0:
            self._gaps[seq] = gap
        if any(other - size <= seq < other for other, size in self._gaps.items()):
            self._inside.add(seq)
        self._taken.add(seq)
        return max(0, gap)

    def commit(self, seq: int, gap: int, lost: int = JUDGED) -> None:
        self._inside.discard(seq)
        heapq.heappush(self._done, (seq - gap, seq, lost))
        while self._done and self._done[0][0] <= self.upto + 1:
            _, end, refused = self._done[0]
            if self._inside and (awaited := min(self._inside)) < end:
                self.upto = max(self.upto, awaited - 1)
                break
            heapq.heappop(self._done)
            self._taken.discard(end)
            self._gaps.pop(end, None)
            self._lost = 0 if refused == JUDGED else self._lost + refused
            self.upto = max(self.upto, end)


NUMBERS = st.integers(1, 30)
HAPPENINGS = st.one_of(
    st.tuples(st.just("take"), NUMBERS, st.just(0)),
    st.tuples(st.just("take"), NUMBERS, st.just(0)),
    st.tuples(st.just("commit"), st.integers(0, 30), st.integers(JUDGED, 3)),
    st.tuples(st.just("commit"), st.integers(0, 30), st.integers(JUDGED, 3)),
    st.tuples(st.just("hold"), NUMBERS, st.just(0)),
    st.tuples(st.sampled_from(["resume", "restart", "restore"]), st.just(0), st.just(0)),
)
DOWN = [("take", seq, 0) for seq in (1, *range(30, 1, -1))]
ODD_FIRST = [("take", seq, 0) for seq in (*range(1, 31, 2), *range(2, 31, 2))]


@settings(max_examples=1500, deadline=None)
@given(st.lists(HAPPENINGS, max_size=70))
@example([*DOWN, *[("commit", 0, JUDGED)] * 30])
@example([*DOWN, *[("commit", 30, JUDGED)] * 30])
@example([*ODD_FIRST, ("resume", 0, 0), *[("commit", 3, 1)] * 30])
@example([("take", 10, 0), ("resume", 0, 0), *ODD_FIRST, ("commit", 0, JUDGED), ("take", 30, 0), ("take", 20, 0)])
def test_numbers_are_counted_as_by_the_simple_form(found: list[Happening]) -> None:
    numbering, simple = Numbering(), Simple()
    taken: list[tuple[int, int]] = []
    for what, number, lost in found:
        match what:
            case "take":
                gap = numbering.take(number)
                assert gap == simple.take(number)
                taken += [] if gap is None else [(number, gap)]
            case "commit" if taken:
                seq, gap = taken.pop(number % len(taken))
                numbering.commit(seq, gap, lost)
                simple.commit(seq, gap, lost)
            case "hold":
                numbering.hold(number)
                simple.hold(number)
            case "resume":
                numbering.resume()
                simple.resume()
            case "restart":
                numbering.restart()
                simple.restart()
            case "restore":
                saved, taken = numbering.saved(), []
                numbering, simple = Numbering((), saved), Simple(saved)
        assert (numbering.next, numbering.upto, numbering.saved()) == (simple.next, simple.upto, simple.saved())


class Counted(int):
    """A number that counts how often one is compared with another."""

    comparisons = 0

    def __lt__(self, other: int) -> bool:
        Counted.comparisons += 1
        return int(self) < int(other)

    def __gt__(self, other: int) -> bool:
        Counted.comparisons += 1
        return int(self) > int(other)

    def __le__(self, other: int) -> bool:
        Counted.comparisons += 1
        return int(self) <= int(other)

    def __sub__(self, other: int) -> Counted:
        return Counted(int(self) - other)

    __hash__ = int.__hash__


def sequences(count: int) -> dict[str, Iterable[int]]:
    """Numbers up to one, as a monitor may send them."""
    return {
        "down": (1, *range(count, 1, -1)),
        "odd ones first": (*range(1, count + 1, 2), *range(2, count + 1, 2)),
    }


@pytest.mark.parametrize("kind", ["down", "odd ones first"])
def test_a_number_costs_no_more_where_there_are_many(kind: str) -> None:
    """The server has one thread for all sessions: one of them must not make it look through thousands each time."""

    def cost(count: int) -> float:
        numbering, gaps = Numbering(), dict[int, int]()
        Counted.comparisons = 0
        for seq in map(Counted, sequences(count)[kind]):
            taken = numbering.take(seq)
            assert taken is not None
            gaps[seq] = taken
        for used, gap in gaps.items():
            numbering.commit(used, gap)
        assert numbering.upto == count
        return Counted.comparisons / count

    assert cost(3000) < 2 * cost(300)
