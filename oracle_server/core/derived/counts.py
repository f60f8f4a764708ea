"""How many samples there are in a window, and how many a second."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection
from fractions import Fraction

from oracle_server.core.derived.definition import MAX_SAMPLES
from oracle_server.core.derived.flips import answer, counts_below
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import OFTEN, TIME, Asked, Left, Taken, Window, least
from oracle_server.core.events import Signals
from oracle_server.core.formula.tree import Constraint

SECOND = 10**9


class Count(Window):
    """How many there are: an integer."""

    __slots__ = ()

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Add one; returns how many there are then."""
        if sample is FAILED or self.budget.used >= MAX_SAMPLES:
            return super().take(sample, now, number, signals, failed)
        entries = self.journal.entries
        if entries is not None:
            entries.append(Taken(self, self.last, self.head))
        self.last = number
        at = now if self.clock == TIME else number
        limit = at - self.width
        places, head = self.places, self.head
        places.append(at)
        after = head + 1
        if places[head] > limit:
            self.budget.used += 1
        elif after & OFTEN and places[after] > limit:
            self.head = after  # one comes and one leaves, as most often
        else:
            self.budget.used += 1
            self.pass_by(limit)
        return len(places) - self.head if self.failed_at is None or self.failed_at <= limit else FAILED

    def value(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """How many there are at a step."""
        limit = (now if self.clock == TIME else number) - self.width
        places, head = self.places, self.head
        if head < len(places) and places[head] <= limit:
            after = head + 1
            if after & OFTEN and (after == len(places) or places[after] > limit):
                if self.journal.entries is not None:
                    self.journal.entries.append(Left(self, head))
                self.head = after  # as most often
                self.budget.used -= 1
            else:
                self.move(limit)
        if self.failed_at is not None and self.failed_at > limit:
            return FAILED
        return len(places) - self.head

    def at(self, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """How many there are at a tick."""
        limit = self.position(now, number) - self.width
        if self.fails(limit):
            return FAILED
        return self.counted(limit)

    def counted(self, limit: int) -> int:
        """How many there are behind a limit."""
        return len(self.places) - bisect_right(self.places, limit, self.head)

    def next_change(self, after: int, asked: Asked) -> int | None:
        """When so many have left that an answer turns."""
        if self.clock != TIME:
            return None
        mending = self.next_mending(after)
        if mending is not None:
            return mending
        count = self.counted(after - self.width)
        found = [left for each in asked if (left := self._left(count, each)) is not None]
        if not found:
            return None
        return self.places[len(self.places) - max(found) - 1] + self.width

    def worth(self, count: int) -> int | float:
        """The signal of so many."""
        return count

    @property
    def per_one(self) -> Fraction:
        """How much the signal grows with one more."""
        return Fraction(1)

    def _left(self, count: int, asked: Constraint) -> int | None:
        """How many are left when an answer turns first, as samples leave."""
        candidates = counts_below(count, asked, self.per_one)
        if candidates is None:
            return count - 1 if count else None
        now = answer(asked, self.worth(count))
        return next((n for n in candidates if answer(asked, self.worth(n)) != now), None)


class Rate(Count):
    """How many there are a second, which is not known before so much time has passed."""

    __slots__ = ()

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Add one; returns the rate with it."""
        return self._rate(Count.take(self, sample, now, number, signals, failed), now)  # a rate stays as it is

    def value(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """The rate at a step."""
        return self._rate(super().value(now, number, signals, failed), now)

    def at(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """The rate at a tick."""
        return self._rate(super().at(now, number, signals, failed), now)

    def next_change(self, after: int, asked: Asked) -> int | None:
        """When an answer turns, and when the rate is known."""
        begun = self.session.begun
        if begun is not None and after < begun + self.width:
            return least(begun + self.width, self.next_mending(after))
        return super().next_change(after, asked)

    def worth(self, count: int) -> float:
        """The rate of so many."""
        return count * SECOND / self.width

    @property
    def per_one(self) -> Fraction:
        """How much the rate grows with one more."""
        return Fraction(SECOND, self.width)

    def _rate(self, count: Value | None, now: int) -> Value | None:
        if type(count) is not int:
            return count
        begun = self.session.begun
        return count * SECOND / self.width if begun is not None and now >= begun + self.width else None
