"""`eventually` and `always`: at each key the steps about which something is awaited, oldest first.

An operand that is true at a step meets all those within its reach at once, which stand side by side. `always` is the
dual: `always φ` is `not eventually not φ`, and the answers are turned.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from functools import partial
from typing import Any

from oracle_server.core.formula.tree import Bound
from oracle_server.engines.native.keys import Key, read_key
from oracle_server.engines.native.waiting import (
    FALSE,
    LOST,
    NEGATED,
    OPEN,
    TRUE,
    Above,
    Awaited,
    Deadlines,
    Moment,
    Present,
    place_of,
)


class Row:
    """What is awaited at one key: `starts`, of which the first `over` wait for open answers alone.

    `pending` are the steps about which the operand's answer is open, and `lost` those about which it is lost.
    """

    __slots__ = ("lost", "over", "pending", "starts")

    def __init__(self) -> None:
        self.starts: list[Moment] = []
        self.pending: list[Moment] = []
        self.lost: list[Moment] = []
        self.over = 0


class Eventually:
    """`eventually[a:b] φ`, or `always` where `dual`."""

    above: Above
    slot = 0

    def __init__(self, present: Present, operand: Awaited, bound: Bound, *, dual: bool) -> None:
        self._present, self._operand, self._dual = present, operand, dual
        self._lower, self._upper = bound.lower, bound.upper
        self._neutral = TRUE if dual else FALSE
        self.rows: dict[Key, Row] = {}
        self.deadlines = Deadlines(present, bound.upper)
        operand.above, operand.slot = self, 0
        self._asked: Moment | None = None
        self._answer = OPEN

    def step(self, key: Key, ask: bool) -> int:
        """Take the present step; see `Awaited`."""
        row, present, moment = self.rows.get(key), self._present, self._present.moment
        if ask:
            if row is None:
                row = Row()
                present.put(self.rows, key, row)
            present.count(1)
            present.append(row.starts, moment)
            self.deadlines.add(key, moment)
            self._asked, self._answer = moment, OPEN
        elif row is None:
            return OPEN
        low, high = self._reach(row, moment)
        value = self._operand.step(key, low < high)
        if low < high:
            self._take(key, row, moment, NEGATED[value] if self._dual else value)
        self._close(key, row)
        self._asked = None
        return self._answer

    def _take(self, key: Key, row: Row, moment: Moment, value: int) -> None:
        """Take the operand's answer about the present step; what it told before may have decided some."""
        if value == FALSE:
            return
        low, high = self._reach(row, moment)
        if value == TRUE:
            self._decide(key, row, low, high)
        elif value == LOST and low < high:
            self._present.append(row.lost, moment)
        elif value == OPEN and low < high:
            self._present.append(row.pending, moment)
        elif value == OPEN:
            self._operand.cancel(key, moment)

    def resolved(self, key: Key, slot: int, about: Moment, value: int) -> None:  # noqa: ARG002 -- there is one
        """Take an answer that was open."""
        row = self.rows.get(key)
        place = None if row is None else place_of(row.pending, about)
        if row is None or place is None:
            return
        self._present.cut(row.pending, place, place + 1)
        value = NEGATED[value] if self._dual else value
        low, high = self._reach(row, about)
        if value == TRUE:
            self._decide(key, row, low, high)
            return
        if value == LOST:
            self._present.insert(row.lost, bisect_left(row.lost, about), about)
        for start in row.starts[low : min(high, row.over)]:  # some of those that are over waited for this alone
            place = place_of(row.starts, start)
            if place is not None and place < row.over and not self._any(row.pending, start):
                self._settle(key, row, place)
        self._tidy(key, row)

    def passed(self, key: Key) -> None:
        """Settle what time has decided."""
        self._operand.passed(key)
        row = self.rows.get(key)
        if row is not None:
            self._close(key, row)

    def cancel(self, key: Key, about: Moment) -> None:
        """Forget an open question."""
        row = self.rows.get(key)
        place = None if row is None else place_of(row.starts, about)
        if row is not None and place is not None:
            self._remove(row, place, place + 1)
            self._tidy(key, row)

    def quiet(self, key: Key) -> int | None:  # noqa: ARG002 -- each step is waited about
        """None: each step is waited about."""
        return None

    def is_still(self, key: Key) -> bool:
        """Whether its operand decides nothing as it is."""
        if key not in self.rows:
            return True
        return self._operand.quiet(key) == self._neutral and self._operand.is_still(key)

    def snapshot(self) -> Any:
        """All rows as plain data."""
        rows = [(key, row.starts, row.pending, row.lost, row.over) for key, row in self.rows.items()]
        return [rows, list(self.deadlines.queue), self._operand.snapshot()]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        rows, queue, operand = data
        for key, starts, pending, lost, over in rows:
            row = self.rows[read_key(key)] = Row()
            row.starts, row.pending, row.lost = ([(t, n) for t, n in found] for found in (starts, pending, lost))
            row.over = over
        self.deadlines.queue.extend((read_key(key), (t, n)) for key, (t, n) in queue)
        self._operand.restore(operand)

    def _reach(self, row: Row, about: Moment) -> tuple[int, int]:
        """The starts within whose bound a step is: from which place up to which."""
        starts, time = row.starts, about[0]
        low = 0
        if self._upper is not None and starts and starts[0][0] < time - self._upper:
            low = bisect_left(starts, (time - self._upper,))
        if self._lower:
            high = bisect_left(starts, (time - self._lower + 1,))
        else:
            high = len(starts) if not starts or starts[-1] <= about else bisect_right(starts, about)
        return low, max(low, high)

    def _any(self, steps: list[Moment], start: Moment) -> bool:
        """Whether one of some steps is within the bound of a start."""
        place = bisect_left(steps, max((start[0] + self._lower, 0), start))
        if place == len(steps):
            return False
        return self._upper is None or steps[place][0] <= start[0] + self._upper

    def _close(self, key: Key, row: Row) -> None:
        """Settle those that are over, but for those that wait for open answers."""
        present = self._present
        while row.over < len(row.starts) and present.is_over(row.starts[row.over], self._upper):
            if row.pending and self._any(row.pending, row.starts[row.over]):
                self._set_over(row, row.over + 1)
            else:
                self._settle(key, row, row.over)
        if not row.starts:
            self._tidy(key, row)

    def _settle(self, key: Key, row: Row, place: int) -> None:
        """Decide a start that nothing met."""
        start = row.starts[place]
        value = LOST if row.lost and self._any(row.lost, start) else FALSE
        self._remove(row, place, place + 1)
        self._tell(key, start, value)

    def _decide(self, key: Key, row: Row, low: int, high: int) -> None:
        for start in self._remove(row, low, high):
            self._tell(key, start, TRUE)
        self._tidy(key, row)

    def _tell(self, key: Key, about: Moment, value: int) -> None:
        value = NEGATED[value] if self._dual else value
        if about == self._asked:
            self._answer = value
        else:
            self.above.resolved(key, self.slot, about, value)

    def _remove(self, row: Row, low: int, high: int) -> list[Moment]:
        if low >= high:
            return []
        self._present.count(low - high)
        if row.over > low:
            self._set_over(row, row.over - (min(high, row.over) - low))
        return self._present.cut(row.starts, low, high)

    def _set_over(self, row: Row, over: int) -> None:
        self._present.note(partial(setattr, row, "over", row.over))
        row.over = over

    def _tidy(self, key: Key, row: Row) -> None:
        """Let go of what no start waits for any more."""
        present = self._present
        if row.pending or row.lost:
            present.timeline.spend((len(row.pending) + len(row.lost)) // 16)
            for about in row.lost.copy():
                self._drop(row, row.lost, about)
            for about in row.pending.copy():
                if self._drop(row, row.pending, about):
                    self._operand.cancel(key, about)
        if not row.starts and self.rows.get(key) is row:
            present.pop(self.rows, key)

    def _drop(self, row: Row, steps: list[Moment], about: Moment) -> bool:
        low, high = self._reach(row, about)
        place = None if low < high else place_of(steps, about)
        if place is None:
            return False
        self._present.cut(steps, place, place + 1)
        return True
