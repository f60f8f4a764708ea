"""The exact sum of the numbers in a window, and their mean."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection
from functools import partial
from typing import Any

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import Session, Window
from oracle_server.core.events import Signals

_SCALE = 1074
"""Each double is a whole number of 2^-1074: so many are added, and taken away again, without any error."""
_ONE = 1 << _SCALE


class Sum(Window):
    """The sum, rounded once: the double that is nearest to it."""

    __slots__ = ("_ahead", "_total", "_values")

    def __init__(self, definition: Definition, session: Session) -> None:
        super().__init__(definition, session)
        self._values: list[float] = []
        self.columns = (self.places, self._values)
        self._total = 0
        self._ahead: tuple[int, int] | None = None
        """At the last tick: where the window began, and the total. Steps, and what takes them back, end it."""

    def add(self, at: int, _sample: Value) -> None:
        """Add a number."""
        number = float(_sample)  # type: ignore[arg-type] # others are `FAILED`
        self._ahead = None
        self._values.append(number)
        if self.session.journal.entries is not None:
            self.session.journal.entries.append(partial(self._untotal, self._total))
        self._total += _scaled(number)
        super().add(at, _sample)

    def leave(self, head: int) -> None:
        """Take away those that leave."""
        self._ahead = None
        if self.session.journal.entries is not None:
            self.session.journal.entries.append(partial(self._untotal, self._total))
        for i in range(self.head, head):
            self._total -= _scaled(self._values[i])
        super().leave(head)

    def value(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The sum at a step."""
        limit = self.position(now, number) - self.width
        if self.head < len(self.places) and self.places[self.head] <= limit:
            self.leave(bisect_right(self.places, limit, self.head))
        if self.failed_at is not None and self.failed_at > limit:
            return FAILED
        return self.worth(self._total, len(self.places) - self.head)

    def at(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The sum at a tick; each sample is taken away once, where ticks go on."""
        limit = self.position(now, number) - self.width
        if self.fails(limit):
            return FAILED
        begin = bisect_right(self.places, limit, self.head)
        head, total = self._ahead if self._ahead is not None and self._ahead[0] <= begin else (self.head, self._total)
        for i in range(head, begin):
            total -= _scaled(self._values[i])
        self._ahead = begin, total
        return self.worth(total, len(self.places) - begin)

    def worth(self, total: int, _count: int) -> Value | None:
        """The signal of a total."""
        try:
            return total / _ONE
        except OverflowError:
            return FAILED

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        super().restore(data)
        self._total = sum(_scaled(number) for number in self._values)
        self._ahead = None

    def _untotal(self, total: int) -> None:
        self._total, self._ahead = total, None


class Mean(Sum):
    """The sum by how many there are."""

    __slots__ = ()

    def worth(self, total: int, count: int) -> Value | None:
        """The signal of a total of so many."""
        if not count:
            return None
        try:
            return total / _ONE / count
        except OverflowError:
            return FAILED


def _scaled(number: float) -> int:
    numerator, denominator = number.as_integer_ratio()
    return numerator << (_SCALE + 1 - denominator.bit_length())
