"""Where a session's properties stand otherwise than before: few records of many, for what draws them over time."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing
from functools import partial
from typing import NamedTuple

from oracle_server.core.events import Order
from oracle_server.core.records import VerdictRecord
from oracle_server.core.verdicts import Outcome
from oracle_server.history.pages import unbroken
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.views import records, said


async def changed_records(history: Reading, session: SessionRecord) -> AsyncGenerator[list[VerdictRecord], None]:
    """The records of a session's committed steps that `Changes` takes, page by page. Raises `HistoryError`."""
    changes = Changes(session.properties)
    async with aclosing(unbroken(history, session.number)) as pages:
        async for page in pages:
            yield await history.in_thread(partial(changes.take, page))
    yield await history.in_thread(changes.rest)


class _Told(NamedTuple):
    """What was said of all properties, an entry each."""

    outcomes: tuple[Outcome | None, ...]
    degraded: tuple[bool, ...]
    robustness: tuple[float | None, ...]


class Changes:
    """Takes steps in the sequence in which they were judged, and tells what of them is new, as it stands."""

    def __init__(self, properties: tuple[str, ...]) -> None:
        self._properties, self._none = properties, (None,) * len(properties)
        self._told: dict[Order, _Told] = {}
        self._last: dict[Order, StoredStep] = {}
        self._made: dict[tuple[Order, str], int] = {}
        """The `n` of the last record of each property in each order."""

    def take(self, steps: Sequence[StoredStep]) -> list[VerdictRecord]:
        """The records among some steps of which outcome, `degraded` or robustness changed, and those of violations."""
        return [record for step in steps if step.revision is None for record in self._new(step)]

    def rest(self) -> list[VerdictRecord]:
        """The records of the last step of each order that were not told yet: until then nothing changed."""
        found = [r for step in self._last.values() for r in records(step, self._properties, "standing")]
        return [record for record in found if self._made[record["order"], record["property"]] != record["n"]]

    def _new(self, step: StoredStep) -> list[VerdictRecord]:
        told = said(step, "standing")
        now = _Told(told.outcomes, told.degraded, step.robustness or self._none)
        before = self._told.get(step.order)
        if None in now.outcomes:  # a deadline that does not stand any more
            return []
        self._told[step.order], self._last[step.order] = now, step
        if now == before and not told.explanations:
            return []
        found = records(step, self._properties, "standing")
        if before is not None:
            same = [new == old for new, old in zip(zip(*now, strict=True), zip(*before, strict=True), strict=True)]
            found = [r for r, is_same in zip(found, same, strict=True) if r["violation"] or not is_same]
        self._made |= {(step.order, record["property"]): record["n"] for record in found}
        return found
