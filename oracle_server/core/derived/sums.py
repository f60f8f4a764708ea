"""The exact sum of the numbers in a window, and their mean."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection
from functools import partial
from typing import Any

from oracle_server.core.derived.definition import MAX_SAMPLES, Definition
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import OFTEN, TIME, Left, Session, Taken, Window
from oracle_server.core.events import Signals

_GRAIN = 64
"""Binary digits behind the point come in so many: each double has at most 1074, and is a whole number of such units."""
_PLAIN = 1 << 900
"""Below it a whole number is a double's, once it is rounded."""
_QUICK = 900
"""Up to so many of them, and few numbers have more, doubles do the scaling."""


class Sum(Window):
    """The sum, rounded once: the double that is nearest to it.

    The total, and each number, is kept as a whole number of 2^-`_digits`: fine enough for each number that was added.
    """

    __slots__ = ("_ahead", "_digits", "_inverse", "_total", "_unit", "_wholes")

    def __init__(self, definition: Definition, session: Session) -> None:
        super().__init__(definition, session)
        self._wholes: list[int] = []
        self.columns = (self.places, self._wholes)
        self._total = 0
        self._set_digits(0)
        self._ahead: tuple[int, int] | None = None
        """At the last tick: where the window began, and the total. Steps, and what takes them back, end it."""

    def add(self, at: int, sample: Value) -> None:
        """Add a number; who calls this notes it."""
        whole = self._whole(float(sample))  # type: ignore[arg-type] # others are `FAILED`
        self._ahead = None
        self._total += whole
        self._wholes.append(whole)
        self.places.append(at)
        self.budget.used += 1

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Add a number; returns the sum with it."""
        if sample is FAILED or self.clock != TIME or self.budget.used >= MAX_SAMPLES:
            return super().take(sample, now, number, signals, failed)
        entries = self.journal.entries
        if entries is not None:
            entries.append(Taken(self, self.last, self.head))
        self.last = number
        exact = float(sample)  # type: ignore[arg-type] # others are `FAILED`
        try:
            whole = int(times := exact * self._unit)
        except (OverflowError, ValueError):  # as in `_whole`
            whole = self._whole(exact)
        else:
            if whole != times:
                whole = self._whole(exact)
        self._ahead = None
        limit = now - self.width
        places, wholes, head = self.places, self._wholes, self.head
        places.append(now)
        wholes.append(whole)
        after = head + 1
        if places[head] > limit:
            self._total += whole
            self.budget.used += 1
        elif after & OFTEN and places[after] > limit:
            self._total += whole - wholes[head]
            self.head = after  # one comes and one leaves, as most often
        else:
            self._total += whole
            self.budget.used += 1
            self.pass_by(limit)
        if self.failed_at is not None and self.failed_at > limit:
            return FAILED
        return self.worth(self._total, len(places) - self.head)

    def begin_at(self, head: int) -> None:
        """Take away those that leave."""
        self._ahead = None
        self._total -= sum(self._wholes[self.head : head])
        super().begin_at(head)

    def unleave(self, head: int) -> None:
        """Add those that had left."""
        self._ahead = None
        self._total += sum(self._wholes[head : self.head])
        super().unleave(head)

    def untake(self, last: int, head: int) -> None:
        """Take away the last one, and add those that had left with it."""
        self._total -= self._wholes[-1]
        super().untake(last, head)

    def value(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The sum at a step."""
        limit = (now if self.clock == TIME else self.position(now, number)) - self.width
        places, head = self.places, self.head
        if head < len(places) and places[head] <= limit:
            after = head + 1
            if after & OFTEN and (after == len(places) or places[after] > limit):
                if self.journal.entries is not None:
                    self.journal.entries.append(Left(self, head))
                self._ahead = None
                self._total -= self._wholes[head]
                self.head = after  # as most often
                self.budget.used -= 1
            else:
                self.move(limit)
        if self.failed_at is not None and self.failed_at > limit:
            return FAILED
        return self.worth(self._total, len(places) - self.head)

    def at(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The sum at a tick; each sample is taken away once, where ticks go on."""
        limit = self.position(now, number) - self.width
        if self.fails(limit):
            return FAILED
        begin = bisect_right(self.places, limit, self.head)
        head, total = self._ahead if self._ahead is not None and self._ahead[0] <= begin else (self.head, self._total)
        total -= sum(self._wholes[head:begin])
        self._ahead = begin, total
        return self.worth(total, len(self.places) - begin)

    def worth(self, total: int, _count: int) -> Value | None:
        """The signal of a total."""
        try:
            return float(total) * self._inverse if self._inverse else total / (1 << self._digits)
        except OverflowError:
            return self._large(total)

    def snapshot(self) -> Any:
        """The window as plain data, with the numbers as doubles."""
        *rest, wholes = super().snapshot()
        return [*rest, [whole / (1 << self._digits) for whole in wholes]]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        *rest, numbers = data
        super().restore([*rest, ()])
        for number in numbers:
            self._wholes.append(self._whole(number))
        self._total, self._ahead = sum(self._wholes), None

    def _whole(self, number: float) -> int:
        """A number in the total's units, which become finer where it is finer."""
        try:
            times = number * self._unit
            whole = int(times)
            if whole == times:
                return whole
        except (OverflowError, ValueError):  # too large for a double, or finer than doubles scale
            pass
        numerator, denominator = number.as_integer_ratio()
        digits = denominator.bit_length() - 1
        if digits > self._digits:
            self._refine(-(-digits // _GRAIN) * _GRAIN)
        return numerator << (self._digits - digits)

    def _refine(self, digits: int) -> None:
        """Go on in finer units."""
        more = digits - self._digits
        if self.journal.entries is not None:
            self.journal.entries.append(partial(self._coarsen, more))
        self._wholes[:] = [whole << more for whole in self._wholes]
        self._total <<= more
        self._set_digits(digits)

    def _set_digits(self, digits: int) -> None:
        self._digits = digits
        self._unit = 2.0**digits if digits <= _QUICK else float("inf")
        self._inverse = 2.0**-digits if digits <= _QUICK else 0.0

    def _large(self, total: int) -> Value:
        """The signal of a total with more binary digits than doubles have places."""
        try:
            return total / (1 << self._digits)
        except OverflowError:
            return FAILED

    def _coarsen(self, more: int) -> None:
        """Go back to coarser units: none is finer but a number that is taken back next."""
        self._wholes[:] = [whole >> more for whole in self._wholes]
        self._total >>= more
        self._set_digits(self._digits - more)
        self._ahead = None


class Mean(Sum):
    """The sum by how many there are."""

    __slots__ = ()

    def worth(self, total: int, count: int) -> Value | None:
        """The signal of a total of so many."""
        if not count:
            return None
        if self._inverse and -_PLAIN < total < _PLAIN:
            return float(total) * self._inverse / count
        found = super().worth(total, count)
        return found / count if isinstance(found, float) else found
