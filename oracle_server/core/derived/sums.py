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

_FINEST = 1074
"""Each double is a whole number of 2^-1074: so many are added, and taken away again, without any error."""
_QUICK = 900
"""Up to so many binary digits behind the point, which few numbers have, doubles do the scaling."""


class Sum(Window):
    """The sum, rounded once: the double that is nearest to it.

    The total is a whole number of 2^-`_digits`, which are as many as the finest number had that was added.
    """

    __slots__ = ("_ahead", "_digits", "_inverse", "_total", "_unit", "_values")

    def __init__(self, definition: Definition, session: Session) -> None:
        super().__init__(definition, session)
        self._values: list[float] = []
        self.columns = (self.places, self._values)
        self._total = 0
        self._scale(0)
        self._ahead: tuple[int, int] | None = None
        """At the last tick: where the window began, and the total. Steps, and what takes them back, end it."""

    def add(self, at: int, sample: Value) -> None:
        """Add a number."""
        number = float(sample)  # type: ignore[arg-type] # others are `FAILED`
        entries = self.journal.entries
        if entries is not None:
            entries.append(partial(self._untotal, self._total, self._digits))
        scaled = self._scaled(number)
        self._ahead = None
        self._total += scaled
        self._values.append(number)
        self.places.append(at)
        self.budget.used += 1
        if entries is not None:
            entries.append(self._unadd)

    def leave(self, head: int) -> None:
        """Take away those that leave."""
        if self.journal.entries is not None:
            self.journal.entries.append(partial(self._untotal, self._total, self._digits))
        self._ahead = None
        values, scaled = self._values, self._scaled
        for i in range(self.head, head):
            self._total -= scaled(values[i])
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
            total -= self._scaled(self._values[i])
        self._ahead = begin, total
        return self.worth(total, len(self.places) - begin)

    def worth(self, total: int, _count: int) -> Value | None:
        """The signal of a total."""
        try:
            return float(total) * self._inverse if self._inverse else total / (1 << self._digits)
        except OverflowError:
            return self._large(total)

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        super().restore(data)
        self._total, self._ahead = 0, None
        for number in self._values:
            scaled = self._scaled(number)
            self._total += scaled

    def _scaled(self, number: float) -> int:
        """A number as a whole number of the total's units, which become finer where it is finer."""
        try:
            times = number * self._unit
            scaled = int(times)
            if scaled == times:
                return scaled
        except (OverflowError, ValueError):  # too large for a double, or finer than doubles scale
            pass
        numerator, denominator = number.as_integer_ratio()
        digits = denominator.bit_length() - 1
        if digits > self._digits:
            self._total <<= digits - self._digits
            self._scale(digits)
        return numerator << (self._digits - digits)

    def _scale(self, digits: int) -> None:
        self._digits = digits if digits <= _QUICK else _FINEST
        self._total <<= self._digits - digits
        self._unit = 2.0**digits if digits <= _QUICK else float("inf")
        self._inverse = 2.0**-digits if digits <= _QUICK else 0.0

    def _large(self, total: int) -> Value:
        """The signal of a total with more binary digits than doubles have places."""
        try:
            return total / (1 << self._digits)
        except OverflowError:
            return FAILED

    def _untotal(self, total: int, digits: int) -> None:
        self._total, self._ahead = total, None
        self._digits = digits
        self._unit = 2.0**digits if digits <= _QUICK else float("inf")
        self._inverse = 2.0**-digits if digits <= _QUICK else 0.0


class Mean(Sum):
    """The sum by how many there are."""

    __slots__ = ()

    def worth(self, total: int, count: int) -> Value | None:
        """The signal of a total of so many."""
        if not count:
            return None
        found = super().worth(total, count)
        return found / count if isinstance(found, float) else found
