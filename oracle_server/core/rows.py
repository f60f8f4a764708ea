"""Rows: elements of an event's message that are judged one after the other, as steps of their own."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

import msgspec

from oracle_server.core.events import Order, Step
from oracle_server.core.verdicts import Judged


class Rows(deque[tuple[Order, Step]]):
    """The rows of an event of which the first ones may be judged; nothing else is judged before they all are.

    Each event asks several times whether there are any, which costs nothing of a deque.
    """

    def add(self, order: Order, step: Step) -> None:
        """Let the rows of a step wait."""
        self.extend((order, row) for row in _rows_of(step))

    def judge(self, judge: Callable[[Order, Step], list[Judged]], enough: Callable[[], bool] | None) -> list[Judged]:
        """Judge those that wait, until `enough`; None: all of them."""
        judged: list[Judged] = []
        while self:
            judged += judge(*self.popleft())
            if enough is not None and enough():
                break
        return judged


def _rows_of(step: Step) -> Iterator[Step]:
    """The steps that are judged instead of one with rows.

    What was lost before it was lost before the first of them, and it is decided, where that is asked, with the last.
    """
    last = len(step.rows) - 1
    for i, (signals, failed) in enumerate(step.rows):
        whole, more = step.event, i < last
        lost, ask = 0 if i else whole.lost, whole.ask and not more
        event = msgspec.structs.replace(whole, row=i, more=more, lost=lost, ask=ask)
        yield msgspec.structs.replace(step, event=event, signals=signals, failed=failed, rows=())
