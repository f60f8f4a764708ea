"""The least and the largest of the numbers in a window."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection
from functools import partial
from typing import Any

from oracle_server.core.derived.definition import MAX_SAMPLES, Definition
from oracle_server.core.derived.flips import first_turn
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import TIME, Asked, Session, Window
from oracle_server.core.events import Signals


class Extreme(Window):
    """Only the samples that may be the least one yet are kept: their values grow. The largest is the least negated."""

    __slots__ = ("_sign", "_timed", "_values")

    def __init__(self, definition: Definition, session: Session) -> None:
        super().__init__(definition, session)
        self._sign = -1 if definition.op == "max" else 1
        self._timed = definition.timed
        self._values: list[int | float] = []
        self.columns = (self.places, self._values)

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Add a number; returns the extreme with it."""
        budget, sign = self.budget, self._sign
        slow = sample is FAILED or self.journal.entries is not None or budget.used >= MAX_SAMPLES
        if slow or not self._timed:
            return super().take(sample, now, number, signals, failed)
        self.last = number
        least: int | float = -sample if sign < 0 else sample  # type: ignore[operator,assignment] # as above
        values, places, head = self._values, self.places, self.head
        size = before = len(values)
        if size > head and values[-1] >= least:
            while size - 1 > head and values[-2] >= least:
                values.pop()
                places.pop()
                size -= 1
            values[-1], places[-1] = least, now
            if size != before:
                budget.used += size - before
        else:
            values.append(least)
            places.append(now)
            budget.used += 1
        limit = now - self.width
        if places[head] <= limit:
            self.pass_by(limit)
            head = self.head
        if self.failed_at is not None and self.failed_at > limit:
            return FAILED
        return -values[head] if sign < 0 else values[head]

    def add(self, at: int, sample: Value) -> None:
        """Add a number, and let go of those that can't be the least one any more; who calls this notes it."""
        number: int | float = sample * self._sign  # type: ignore[operator,assignment] # others are `FAILED`
        values, places, head, end = self._values, self.places, self.head, len(self._values)
        while end > head and values[end - 1] >= number:
            end -= 1
        gone = len(values) - end
        if gone:
            if self.journal.entries is not None:
                self.journal.entries.append(partial(self._uncut, places[end:], values[end:]))
            del values[end:], places[end:]
        values.append(number)
        places.append(at)
        self.budget.used += 1 - gone

    def value(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The extreme at a step."""
        limit = (now if self.clock == TIME else self.position(now, number)) - self.width
        head, places = self.head, self.places
        if head < len(places) and places[head] <= limit:
            self.move(limit)
        if self.failed_at is not None and self.failed_at > limit:
            return FAILED
        return self._values[self.head] * self._sign if self.head < len(self._values) else None

    def at(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The extreme at a tick."""
        limit = self.position(now, number) - self.width
        if self.fails(limit):
            return FAILED
        begin = bisect_right(self.places, limit, self.head)
        return self._values[begin] * self._sign if begin < len(self._values) else None

    def next_change(self, after: int, asked: Asked) -> int | None:
        """When so many have left that an answer turns, and when the last one leaves."""
        if self.clock != TIME:
            return None
        mending = self.next_mending(after)
        begin = bisect_right(self.places, after - self.width, self.head)
        if mending is not None or begin == len(self.places):
            return mending
        turns = [t for each in asked if (t := first_turn(self._values, begin, each, self._sign)) is not None]
        return self.places[min(turns, default=len(self.places)) - 1] + self.width

    def _uncut(self, places: list[int], values: list[Any]) -> None:
        """Put those back, before the number that they gave way to."""
        self.places[-1:-1], self._values[-1:-1] = places, values
        self.budget.used += len(places)
