"""`eventually` and `always`: at each key the steps about which something is awaited, oldest first.

An operand that is true at a step meets all those within its reach at once, which stand side by side. `always` is the
dual: `always φ` is `not eventually not φ`, and the answers are turned.
"""

from __future__ import annotations

from bisect import bisect_left
from functools import partial
from itertools import islice
from typing import Any

from oracle_server.core.formula.tree import Bound
from oracle_server.engines.native.joined import Leaf
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
    Starts,
    moments,
    place_of,
    reach,
    starts_of,
)


class Row:
    """What is awaited at one key: `starts`, and more where an answer of the operand is open or lost."""

    __slots__ = ("more", "starts")

    def __init__(self) -> None:
        self.starts: Starts = []
        self.more: More | None = None


class More:
    """Of the starts, the first `over` wait for open answers alone.

    `pending` are the steps about which the operand's answer is open, and `lost` those about which it is lost.
    """

    __slots__ = ("lost", "over", "pending")

    def __init__(self) -> None:
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
        self.deadlines = Deadlines(present, self.rows, bound.upper)
        operand.above, operand.slot = self, 0
        self._leaf = operand if isinstance(operand, Leaf) else None
        self._holds = _never if self._leaf is None else self._leaf.holds
        """The operand where it answers at once."""
        self._asked: Moment | None = None
        self._answer = OPEN
        self._now = FALSE if dual else TRUE
        """What it comes to where its operand decides."""

    def step(self, key: Key, ask: bool) -> int:
        """Take the present step; see `Awaited`."""
        row, leaf = self.rows.get(key), self._leaf
        if leaf is not None and not leaf.lost and (row is None or row.more is None):
            return self._step_at_once(key, row, ask)
        moment = self._present.moment
        if ask:
            row = self._wait(key, row)
            self._asked, self._answer = moment, OPEN
        elif row is None:
            return OPEN
        low, high = self._reach(row, moment)
        value = self._operand.step(key, low < high)
        if low < high:
            self._take(key, row, moment, NEGATED[value] if self._dual else value)
        self._close(key, row)
        self._asked = None
        return self._answer if ask else OPEN

    def _step_at_once(self, key: Key, row: Row | None, ask: bool) -> int:
        """The same where the operand answers at once, and nothing was open or lost; `passed` ends what is over."""
        met = self._holds(key) is not self._dual
        if met and row is not None:
            low, high = self._reach(row, self._present.moment)
            if high - low == len(row.starts):
                self._meet(key, row)
            else:
                self._decide(key, row, low, high)
            row = self.rows.get(key)
        if not ask:
            return OPEN
        if met and not self._lower:
            return self._now
        self._wait(key, row)
        return OPEN

    def _meet(self, key: Key, row: Row) -> None:
        """Decide all starts of a key."""
        del self.rows[key]
        if self._present.timeline.journal is not None:
            self._present.timeline.journal.append(partial(self.rows.__setitem__, key, row))
        self._present.opened -= len(row.starts)
        if not self.rows:
            self.deadlines.clear()
        value, resolved, slot = self._now, self.above.resolved, self.slot
        for start in row.starts:
            resolved(key, slot, start, value)

    def _wait(self, key: Key, row: Row | None) -> Row:
        """Wait about the present step."""
        present = self._present
        journal, moment = present.timeline.journal, present.moment
        if row is None:
            row = self.rows[key] = Row()
            if journal is not None:
                journal.append(partial(self.rows.pop, key))
        present.start(row)
        if self._upper is not None:
            self.deadlines.add(key, moment)
        return row

    def _take(self, key: Key, row: Row, moment: Moment, value: int) -> None:
        """Take the operand's answer about the present step; what it told before may have decided some."""
        if value == FALSE:
            return
        low, high = self._reach(row, moment)
        if value == TRUE:
            self._decide(key, row, low, high)
        elif low < high:
            more = self._more(row)
            self._present.append(more.lost if value == LOST else more.pending, moment)
        elif value == OPEN:
            self._operand.cancel(key, moment)

    def resolved(self, key: Key, slot: int, about: Moment, value: int) -> None:  # noqa: ARG002 -- there is one
        """Take an answer that was open."""
        row = self.rows.get(key)
        if row is None or row.more is None:
            return
        more = row.more
        place = place_of(more.pending, about)
        if place is None:
            return
        self._present.cut(more.pending, place, place + 1)
        value = NEGATED[value] if self._dual else value
        low, high = self._reach(row, about)
        if value == TRUE:
            self._decide(key, row, low, high)
            return
        if value == LOST:
            self._present.insert(more.lost, bisect_left(more.lost, about), about)
        for start in [
            *islice(row.starts, low, min(high, more.over))
        ]:  # some of those that are over waited for this alone
            place = place_of(row.starts, start)
            if place is not None and place < more.over and not self._any(more.pending, start):
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
        return key not in self.rows or (self._operand.quiet(key) == self._neutral and self._operand.is_still(key))

    def snapshot(self) -> Any:
        """All rows as plain data."""
        rows = [(key, list(row.starts), _data(row.more)) for key, row in self.rows.items()]
        return [rows, self.deadlines.snapshot(), self._operand.snapshot()]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        rows, queue, operand = data
        for key, starts, more in rows:
            row = self.rows[read_key(key)] = Row()
            row.starts = starts_of(starts)
            if more is not None:
                row.more = More()
                row.more.pending, row.more.lost, row.more.over = moments(more[0]), moments(more[1]), more[2]
        self.deadlines.restore(queue)
        self._operand.restore(operand)

    def _reach(self, row: Row, about: Moment) -> tuple[int, int]:
        return reach(row.starts, about, self._lower, self._upper)

    def _any(self, steps: list[Moment], start: Moment) -> bool:
        """Whether one of some steps is within the bound of a start."""
        place = bisect_left(steps, max((start[0] + self._lower, 0), start))
        if place == len(steps):
            return False
        return self._upper is None or steps[place][0] <= start[0] + self._upper

    def _close(self, key: Key, row: Row) -> None:
        """Settle those that are over, but for those that wait for open answers."""
        present, more = self._present, row.more
        if more is None:
            over = 0
            while over < len(row.starts) and present.is_over(row.starts[over], self._upper):
                over += 1
            for start in self._remove(row, 0, over):
                self._tell(key, start, FALSE)
        while more is not None and more.over < len(row.starts):
            if not present.is_over(row.starts[more.over], self._upper):
                break
            if self._any(more.pending, row.starts[more.over]):
                self._set_over(more, more.over + 1)
            else:
                self._settle(key, row, more.over)
        if not row.starts:
            self._tidy(key, row)

    def _settle(self, key: Key, row: Row, place: int) -> None:
        """Decide a start that nothing met."""
        start = row.starts[place]
        value = LOST if row.more is not None and self._any(row.more.lost, start) else FALSE
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
        if row.more is not None and row.more.over > low:
            self._set_over(row.more, row.more.over - (min(high, row.more.over) - low))
        return self._present.cut(row.starts, low, high)

    def _set_over(self, more: More, over: int) -> None:
        self._present.note(partial(setattr, more, "over", more.over))
        more.over = over

    def _more(self, row: Row) -> More:
        if row.more is None:
            row.more = More()
            self._present.note(partial(setattr, row, "more", None))
        return row.more

    def _tidy(self, key: Key, row: Row) -> None:
        """Let go of what no start waits for any more."""
        present, more = self._present, row.more
        if more is not None:
            present.timeline.spend((len(more.pending) + len(more.lost)) // 16)
            for about in more.lost.copy():
                self._drop(row, more.lost, about)
            for about in more.pending.copy():
                if self._drop(row, more.pending, about):
                    self._operand.cancel(key, about)
        if not row.starts and self.rows.get(key) is row:
            present.pop(self.rows, key)
            if not self.rows:
                self.deadlines.clear()

    def _drop(self, row: Row, steps: list[Moment], about: Moment) -> bool:
        low, high = self._reach(row, about)
        place = None if low < high else place_of(steps, about)
        if place is None:
            return False
        self._present.cut(steps, place, place + 1)
        return True


def _never(_: Key) -> bool:
    return False


def _data(more: More | None) -> Any:
    return None if more is None else (more.pending, more.lost, more.over)
