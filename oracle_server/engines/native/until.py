"""`until`: at each key the steps about which something is awaited, and the operands' answers that are not yet settled.

What decides most is settled at once: a right side that is true meets all starts within its reach, a left side that is
false ends all others. Answers are kept only where one of them is open or lost, so that a later one may decide.
"""

from __future__ import annotations

from typing import Any

from oracle_server.core.formula.tree import Bound
from oracle_server.engines.native.joined import Leaf
from oracle_server.engines.native.keys import Key, read_key
from oracle_server.engines.native.timeline import FEW
from oracle_server.engines.native.waiting import (
    FALSE,
    OPEN,
    TRUE,
    Above,
    Awaited,
    Deadlines,
    Moment,
    Present,
    Starts,
    all_of,
    any_of,
    place_of,
    reach,
    starts_of,
)

_LEFT, _RIGHT = 0, 1


class Row:
    """What is awaited at one key: `starts`, oldest first.

    `left` has the steps at which the left side is not true, `right` those at which the right one is not false.
    """

    __slots__ = ("left", "right", "starts")

    def __init__(self) -> None:
        self.starts: Starts = []
        self.left: dict[Moment, int] = {}
        self.right: dict[Moment, int] = {}


class Until:
    """`φ until[a:b] ψ`."""

    above: Above
    slot = 0

    def __init__(self, present: Present, left: Awaited, right: Awaited, bound: Bound) -> None:
        self._present, self._left, self._right = present, left, right
        self._lower, self._upper = bound.lower, bound.upper
        self.rows: dict[Key, Row] = {}
        self.deadlines = Deadlines(present, self.rows, bound.upper)
        left.above = right.above = self
        left.slot, right.slot = _LEFT, _RIGHT
        self._asked: Moment | None = None
        self._answer = OPEN
        self._leaves = (left, right) if isinstance(left, Leaf) and isinstance(right, Leaf) else None
        """The operands where they answer at once."""
        self._busy = False
        """Whether operands are being asked: what they tell meanwhile is looked at when both are known."""

    def step(self, key: Key, ask: bool) -> int:
        """Take the present step; see `Awaited`."""
        row, moment, leaves = self.rows.get(key), self._present.moment, self._leaves
        if leaves is not None and (row is None or not (row.left or row.right)):
            left, right = leaves
            if not left.lost and not right.lost:
                return self._step_at_once(key, row, left.holds(key), right.holds(key), ask)
        if ask:
            row = self._wait(key, row)
            self._asked, self._answer = moment, OPEN
        elif row is None:
            return OPEN
        low, high = self._reach(row, moment)
        within = low < high
        self._busy = True
        answers = self._left.step(key, True), self._right.step(key, within)
        self._busy = False
        self._take(key, row, answers[0], answers[1] if within else FALSE)
        self._asked = None
        return self._answer

    def _step_at_once(self, key: Key, row: Row | None, left: bool, right: bool, ask: bool) -> int:
        """The same where the operands answer at once, and nothing was open or lost; `passed` ends what is over."""
        if row is not None and (right or not left):
            if right:
                self._decide(key, row, *self._reach(row, self._present.moment), TRUE)
            if not left:
                self._decide(key, row, 0, len(row.starts), FALSE)
            self._tidy(key, row)
        if not ask:
            return OPEN
        if right and not self._lower:
            return TRUE
        if not left:
            return FALSE
        self._wait(key, self.rows.get(key))
        return OPEN

    def _wait(self, key: Key, row: Row | None) -> Row:
        """Wait about the present step."""
        present = self._present
        if row is None:
            row = Row()
            present.put(self.rows, key, row)
        present.start(row)
        if self._upper is not None:
            self.deadlines.add(key, present.moment)
        return row

    def _take(self, key: Key, row: Row, left: int, right: int) -> None:
        """Take the operands' answers about the present step."""
        present, moment = self._present, self._present.moment
        if not row.left and not row.right and left in (TRUE, FALSE) and right in (TRUE, FALSE):
            if right == TRUE:
                low, high = self._reach(row, moment)
                self._decide(key, row, low, high, TRUE)
            if left == FALSE:
                self._decide(key, row, 0, len(row.starts), FALSE)
            self._close(key, row)
            return
        if left != TRUE:
            present.put(row.left, moment, left)
        if right != FALSE:
            present.put(row.right, moment, right)
        self._look(key, row)

    def resolved(self, key: Key, slot: int, about: Moment, value: int) -> None:
        """Take an answer that was open."""
        row = self.rows.get(key)
        if row is None:
            return
        answers, neutral = (row.left, TRUE) if slot == _LEFT else (row.right, FALSE)
        if answers.get(about) != OPEN:
            return
        if value == neutral:
            self._present.pop(answers, about)
        else:
            self._present.put(answers, about, value)
        if not self._busy:
            self._look(key, row)

    def passed(self, key: Key) -> None:
        """Settle what time has decided."""
        self._busy = True
        self._left.passed(key)
        self._right.passed(key)
        self._busy = False
        row = self.rows.get(key)
        if row is None:
            return
        if row.left or row.right:
            self._look(key, row)
        else:
            self._close(key, row)

    def cancel(self, key: Key, about: Moment) -> None:
        """Forget an open question."""
        row = self.rows.get(key)
        place = None if row is None else place_of(row.starts, about)
        if row is not None and place is not None:
            self._present.cut(row.starts, place, place + 1)
            self._present.count(-1)
            self._tidy(key, row)

    def quiet(self, key: Key) -> int | None:  # noqa: ARG002 -- each step is waited about
        """None: each step is waited about."""
        return None

    def is_still(self, key: Key) -> bool:
        """Whether its operands decide nothing as they are."""
        if key not in self.rows:
            return True
        neutral = self._left.quiet(key) == TRUE and self._right.quiet(key) == FALSE
        return neutral and self._left.is_still(key) and self._right.is_still(key)

    def snapshot(self) -> Any:
        """All rows as plain data."""
        rows = [
            (key, list(row.starts), list(row.left.items()), list(row.right.items())) for key, row in self.rows.items()
        ]
        return [rows, self.deadlines.snapshot(), self._left.snapshot(), self._right.snapshot()]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        rows, queue, left, right = data
        for key, starts, lefts, rights in rows:
            row = self.rows[read_key(key)] = Row()
            row.starts = starts_of(starts)
            row.left = {(t, n): value for (t, n), value in lefts}
            row.right = {(t, n): value for (t, n), value in rights}
        self.deadlines.restore(queue)
        self._left.restore(left)
        self._right.restore(right)

    def _reach(self, row: Row, about: Moment) -> tuple[int, int]:
        return reach(row.starts, about, self._lower, self._upper)

    def _close(self, key: Key, row: Row) -> None:
        """End those that are over, where no answer is open or lost."""
        starts, over = row.starts, 0
        while over < len(starts) and self._present.is_over(starts[over], self._upper):
            over += 1
        self._decide(key, row, 0, over, FALSE)
        self._tidy(key, row)

    def _decide(self, key: Key, row: Row, low: int, high: int, value: int) -> None:
        if low >= high:
            return
        self._present.count(low - high)
        for start in self._present.cut(row.starts, low, high):
            self._tell(key, start, value)

    def _tell(self, key: Key, about: Moment, value: int) -> None:
        if about == self._asked:
            self._answer = value
        else:
            self.above.resolved(key, self.slot, about, value)

    def _look(self, key: Key, row: Row) -> None:
        """Settle what the answers decide by now."""
        looked = len(row.starts) * (1 + len(row.left) + len(row.right))
        if looked > FEW:
            self._present.timeline.spend(looked // 4)
        for start in row.starts.copy():  # what is told above may cancel some of these
            place = place_of(row.starts, start)
            value = OPEN if place is None else self._value(row, start)
            if place is not None and value != OPEN:
                self._decide(key, row, place, place + 1, value)
        self._tidy(key, row)

    def _value(self, row: Row, start: Moment) -> int:
        lefts = sorted(step for step in row.left if step >= start)
        broken = next((step for step in lefts if row.left[step] == FALSE), None)
        ways = []
        for about in sorted(row.right):
            if self._is_within(start, about) and (broken is None or about <= broken):
                way = all_of([row.right[about], *(row.left[step] for step in lefts if step < about)])
                if way == TRUE:
                    return TRUE
                ways.append(way)
        ended = broken is not None or self._present.is_over(start, self._upper)
        rest = FALSE if ended else all_of([OPEN, *(row.left[step] for step in lefts)])
        return any_of([*ways, rest])

    def _is_within(self, start: Moment, about: Moment) -> bool:
        distance = about[0] - start[0]
        return about >= start and distance >= self._lower and (self._upper is None or distance <= self._upper)

    def _tidy(self, key: Key, row: Row) -> None:
        """Let go of what no start waits for any more."""
        least = row.starts[0] if row.starts else None
        for answers, operand in ((row.left, self._left), (row.right, self._right)):
            if answers:
                for step in [step for step in answers if least is None or step < least]:
                    if self._present.pop(answers, step) == OPEN:
                        operand.cancel(key, step)
        if least is None and self.rows.get(key) is row:
            self._present.pop(self.rows, key)
            if not self.rows:
                self.deadlines.clear()
