"""A question to a history: which verdict records are wanted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from oracle_server.core.records import VerdictRecord
from oracle_server.core.verdicts import Outcome
from oracle_server.history.records import StoredStep
from oracle_server.history.views import View, said

_LAST = 2**62
"""A position behind every step."""


@dataclass(frozen=True, slots=True)
class Query:
    """Which records are wanted; `since` and `until` bound the publication time (ns, both included).

    What is skewed counts as published when it arrived, where it stands in the order.

    `after` is the `n` of the last record seen: the answer goes on behind it, in the direction of `order`. `follows`:
    revisions are wanted too where the view is of what stands, as it is known already what stood before them.
    """

    properties: frozenset[str] = frozenset()
    outcomes: frozenset[Outcome] = frozenset()
    stream: str | None = None
    since: int | None = None
    until: int | None = None
    after: int | None = None
    limit: int = 100
    order: Literal["asc", "desc"] = "asc"
    violations: bool = False
    view: View = "standing"
    follows: bool = False

    @property
    def ascending(self) -> bool:
        """Whether older records come first."""
        return self.order == "asc"

    @property
    def revisions(self) -> bool:
        """Whether revisions are wanted, and not only what stands, or what was said at first."""
        return self.view == "all" or (self.follows and self.view == "standing")

    def start(self, width: int) -> int:
        """The position of the first step that can hold a wanted record, in a session of `width` properties."""
        if self.ascending:
            return 1 if self.after is None else min(self.after // width + 1, _LAST)
        return _LAST if self.after is None else min((self.after - 2) // width + 1, _LAST)

    def may_match(self, step: StoredStep) -> bool:
        """Whether a step may hold a wanted record."""
        told = said(step, self.view).outcomes
        if step.revision is not None:
            told = tuple([change.outcome for change in step.revision.changes if change is not None])
        return (
            (self.stream is None or step.step.event.stream.name == self.stream)
            and (self.since is None or step.step.time >= self.since)
            and (self.until is None or step.step.time <= self.until)
            and (not self.violations or step.tells_violations)
            and (not self.outcomes or not self.outcomes.isdisjoint(told))
            and (self.revisions or step.revision is None)
        )

    def matches(self, record: VerdictRecord) -> bool:
        """Whether a record of a step that may match is wanted."""
        n = record["n"]
        if self.after is not None and (n <= self.after if self.ascending else n >= self.after):
            return False
        if self.violations and not (record["violation"] or record.get("retracted")):
            return False
        if self.properties and record["property"] not in self.properties:
            return False
        return not self.outcomes or record["outcome"] in self.outcomes
