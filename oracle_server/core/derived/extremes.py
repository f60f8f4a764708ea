"""The least and the largest of the numbers in a window."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection
from functools import partial
from typing import Any

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.flips import first_turn
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import TIME, Asked, Session, Window
from oracle_server.core.events import Signals


class Extreme(Window):
    """Only the samples that may be the least one yet are kept: their values grow. The largest is the least negated."""

    __slots__ = ("_sign", "_values")

    def __init__(self, definition: Definition, session: Session) -> None:
        super().__init__(definition, session)
        self._sign = -1 if definition.op == "max" else 1
        self._values: list[int | float] = []
        self.columns = (self.places, self._values)

    def add(self, at: int, _sample: Value) -> None:
        """Add a number, and let go of those that can't be the least one any more."""
        number: int | float = _sample * self._sign  # type: ignore[operator,assignment] # others are `FAILED`
        values, end = self._values, len(self._values)
        while end > self.head and values[end - 1] >= number:
            end -= 1
        if end < len(values):
            if self.session.journal.entries is not None:
                again = partial(self._uncut, self.places[end:], values[end:])
                self.session.journal.entries.append(again)
            self.session.budget.used -= len(values) - end
            del values[end:], self.places[end:]
        values.append(number)
        super().add(at, _sample)

    def value(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The extreme at a step."""
        limit = self.position(now, number) - self.width
        if self.head < len(self.places) and self.places[self.head] <= limit:
            self.leave(bisect_right(self.places, limit, self.head))
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
        self.places += places
        self._values += values
        self.session.budget.used += len(places)
