"""The least of many values that mostly rise, found without a look at each of them."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

_SPARE = 16


class Numbered(Protocol):
    """Something that is told apart, and ordered among equals, by a number."""

    @property
    def number(self) -> int:
        """Its number, which no other one has."""
        ...


T = TypeVar("T", bound=Numbered)


class Least(Generic[T]):
    """The item with the least value, of equal ones that with the least number.

    A heap with an entry for each item, of its value or a lower one of before: only the first entry has to be true, and
    is made so when it is asked for. An item whose value falls is added once more.
    """

    def __init__(self, value: Callable[[T], int | None]) -> None:
        """`value` is what an item has now, None where it does not count any more."""
        self._value = value
        self._heap: list[tuple[int, int, T]] = []
        self._most = _SPARE

    def add(self, item: T) -> None:
        """Add an item, or one whose value has fallen."""
        value = self._value(item)
        if value is None:
            return
        heapq.heappush(self._heap, (value, item.number, item))
        if len(self._heap) > self._most:
            known = {number: item for _, number, item in self._heap}
            self._heap = [(v, n, item) for n, item in known.items() if (v := self._value(item)) is not None]
            heapq.heapify(self._heap)
            self._most = 2 * len(self._heap) + _SPARE

    def first(self) -> tuple[int, T] | None:
        """The least value, and whose it is; None where there is no item."""
        heap = self._heap
        while heap:
            told, number, item = heap[0]
            value = self._value(item)
            if value == told:
                return value, item
            if value is None:
                heapq.heappop(heap)
            else:
                heapq.heapreplace(heap, (value, number, item))
        return None

    def below(self, bound: int, most: int | None = None) -> list[T]:
        """The items with values below a bound, or so many of them, the least ones first."""
        entries: dict[int, tuple[int, int, T]] = {}
        while most is None or len(entries) < most:
            first = self.first()
            if first is None or first[0] >= bound:
                break
            entry = heapq.heappop(self._heap)
            entries[entry[1]] = entry
        for entry in entries.values():
            heapq.heappush(self._heap, entry)
        return [item for _, _, item in entries.values()]
