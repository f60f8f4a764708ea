"""The verdicts of a spec that revises: each is told as it stands, once nothing can change it any more."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Set

import msgspec

from oracle_server.core.records import VerdictRecord
from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Judged, Verdict
from oracle_server.history.records import StoredStep, restated, stored, stored_revision
from oracle_server.history.views import View, records, said

_EVERY = 1024
"""Rows that come between two looks at which ones can still change."""

Handling = tuple[bool, str]
"""Whether an adapter let an event pass that it asked about, and why."""


class Settled(Judged, frozen=True, gc=False):
    """A step with the verdicts that are told of it, and their records; of a revision it has the records only."""

    told: tuple[VerdictRecord, ...] = ()


class Settling:
    """Holds rows back while they can be revised, and counts what was."""

    def __init__(
        self,
        properties: tuple[str, ...],
        view: View,
        changeable: Callable[[], Set[int] | None],
        handling: Callable[[Judged], Handling | None],
        note: Callable[[Settled], None],
    ) -> None:
        """Tell the verdicts of a view, and `note` what stands in the end, whatever is told.

        `changeable` has the positions of the rows that can be revised, None if any; `handling` what was done.
        """
        self.revised = 0
        """How many verdicts stand otherwise than they were said at first."""
        self.retracted = 0
        """How many violations that were said at first do not stand."""
        self.appeared = 0
        """How many violations stand that were not said at first."""
        self._properties, self._view = properties, view
        self._changeable, self._handling, self._note = changeable, handling, note
        self._rows: dict[int, StoredStep] = {}
        self._looked = 0

    def told(self, groups: Iterable[list[Judged]]) -> Iterator[Settled]:
        """What is told of rows; each group of them is what the session gave at once."""
        for group in groups:
            yield from self.take(group)
        yield from self.rest()

    def take(self, group: list[Judged]) -> Iterator[Settled]:
        """What can be told once the session has given these rows."""
        for row in self._keep(group):
            if self._view == "all" or (self._view == "first" and row.revision is None):
                yield from self._as_told(row, self._view)
        if self._looked + _EVERY < len(self._rows):
            yield from self._settle(self._changeable())

    def rest(self) -> Iterator[Settled]:
        """What is left to be told at the end."""
        yield from self._settle(set())

    def _keep(self, group: list[Judged]) -> list[StoredStep]:
        width = len(self._properties)
        taken = []
        for item in group:
            if isinstance(item, Revision):
                taken.append(stored_revision((item.first - 1) // width + 1, item))
            else:
                position = (item.verdicts[0].n - 1) // width + 1
                self._rows[position] = stored(position, 0, item, self._handling(item))
                taken.append(self._rows[position])
        for position, stands in restated(item for item in group if isinstance(item, Revision)).items():
            row = self._rows[position]
            revised = {**row.revised, **stands.revised}
            self._rows[position] = msgspec.structs.replace(row, standing=stands.standing, revised=revised)
        return taken

    def _settle(self, changeable: Set[int] | None) -> Iterator[Settled]:
        """Let go of the first rows, up to one that can still be revised."""
        while changeable is not None and self._rows and (first := next(iter(self._rows))) not in changeable:
            row = self._rows.pop(first)
            self._count(row)
            for settled in self._as_told(row, "standing"):
                self._note(settled)
                if self._view == "standing":
                    yield settled
        self._looked = len(self._rows)

    def _count(self, row: StoredStep) -> None:
        if row.standing is not None:
            before, now = row.explanations.keys(), row.standing.explanations.keys()
            self.revised += sum(map(_differ, row.outcomes, row.standing.outcomes))
            self.retracted += len(before - now)
            self.appeared += len(now - before)

    def _as_told(self, row: StoredStep, view: View) -> Iterator[Settled]:
        """A row as it is told in a view: nothing of a deadline that does not stand."""
        found = tuple(records(row, self._properties, view))
        if not found:
            return
        first, told = (row.position - 1) * len(self._properties) + 1, said(row, view)
        verdicts = tuple(
            Verdict(first + i, self._properties[i], outcome, told.degraded[i])
            for i, outcome in enumerate(told.outcomes)
            if outcome is not None
        )
        yield Settled(row.step, row.number, row.order, row.judged, verdicts, row.decision, row.place, told=found)


def _differ(one: object, other: object) -> bool:
    return one is not other
