"""The last rows of a session, which tell how its properties stand."""

from __future__ import annotations

from collections.abc import Collection
from typing import get_args

from oracle_server.core.events import Order
from oracle_server.core.verdicts import Outcome
from oracle_server.history.port import Reading
from oracle_server.history.records import PropertyStands, SessionRecord, StoredStep
from oracle_server.history.views import said

ORDERS: tuple[Order, ...] = get_args(Order)
_PAGE, _PAGES = 100, 200
"""Rows that are read at once, backwards, and how often: one order is ahead of the other by what is held.

They are in memory together, and may have a megabyte each.
"""


class Last:
    """The last row that tells of each property in an order: none that was skipped, taken back or retracted.

    The last one that was written need not be that, where late events put verdicts right: they have earlier places, and
    so have deadlines that they bring about.
    """

    def __init__(self) -> None:
        self.steps = 0
        """How many steps there are."""
        self.whole = False
        """Whether there is nothing to find in earlier rows."""
        self._revised = False
        self._step: StoredStep | None = None
        self._ticks: list[StoredStep] = []

    def take(self, row: StoredStep) -> None:
        """Take a row, backwards from the last one."""
        self.steps = max(self.steps, row.number or 0)
        if self.whole:
            return
        if row.revision is not None:
            self._revised = True
        elif row.is_tick:
            self._ticks.append(row)
        elif row.number and row.place in (None, row.number):  # a late one is the last where all others are before it
            self._step = self._step or row
            self.whole = row.place is None

    def of(self, index: int) -> StoredStep | None:
        """The row that tells of a property, by its place; None where none does."""
        ticks = [row for row in self._ticks if said(row, "standing").outcomes[index] is not None]
        if self._revised:
            ticks.sort(key=lambda row: (row.step.stamp, row.position), reverse=True)
            ticks = [row for row in ticks[:1] if self._step is None or row.step.stamp >= self._step.step.stamp]
        return ticks[0] if ticks else self._step


async def last_rows(history: Reading, record: SessionRecord, orders: Collection[Order] = ORDERS) -> dict[Order, Last]:
    """What the last rows of each of the orders tell. Raises `HistoryError`."""
    found: dict[Order, Last] = {}
    first, upto = await history.extent(record.number)
    for _ in range(_PAGES):
        since = max(first - 1, upto - _PAGE)
        for row in reversed([row async for rows in history.steps(record.number, since, upto) for row in rows]):
            found.setdefault(row.order, Last()).take(row)
        upto = since
        if upto < first or all(order in found and found[order].whole for order in orders):
            break
    return found


async def standing(history: Reading, record: SessionRecord, known: list[PropertyStands]) -> list[PropertyStands]:
    """How properties stand by their last rows, where violations are `known`. Raises `HistoryError`."""
    found = await last_rows(history, record, (record.decides,))
    last = found.get(record.decides, Last())
    return [stands if (row := last.of(i)) is None else stands_at(row, i, stands) for i, stands in enumerate(known)]


def stands_at(row: StoredStep, index: int, known: PropertyStands) -> PropertyStands:
    """How a property stands at a row that tells of it, where violations are `known`."""
    stood, bypassed = said(row, "standing"), index in row.bypassed
    outcome, degraded = stood.outcomes[index] or Outcome.UNKNOWN, stood.degraded[index] and not bypassed
    return known._replace(outcome=outcome, pending=row.pending.get(index), degraded=degraded, bypassed=bypassed)
