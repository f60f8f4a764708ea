"""Revisions: what was said at steps, and stands otherwise since an event that came late was put in its place."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from oracle_server.core.events import Event
from oracle_server.core.records import CauseRecord, ExplanationRecord, VerdictRecord
from oracle_server.core.verdicts import Choice, Judged, Outcome

MOST_CAUSES = 10
"""Late events that one revision names; of more it has the count only."""


class Change(msgspec.Struct, frozen=True, gc=False):
    """What stands of a run of one property's consecutive verdicts, those numbered from `first` to `last`.

    `n` is the revision's own number. `outcome` is None where the verdicts are retracted: their deadlines would not have
    been judged. `violation`: the property becomes negative at `first`, and did not before; `retracted`: it does not
    any more, or no violation stands there. `decision` is what the decision on the event at `first` would have been,
    where that is another one than what was decided.
    """

    n: int
    property: str
    first: int
    last: int
    outcome: Outcome | None
    degraded: bool
    violation: bool = False
    retracted: bool = False
    decision: Choice | None = None
    explanation: ExplanationRecord | None = None


class Standing(msgspec.Struct, frozen=True, gc=False):
    """What stands at a step that was revised: an entry a property, and an explanation for each violation there.

    The outcomes are None at a deadline that is retracted.
    """

    outcomes: tuple[Outcome | None, ...]
    degraded: tuple[bool, ...]
    explanations: Mapping[int, ExplanationRecord] = {}


class Revision(Judged, frozen=True, gc=False, kw_only=True):
    """A row that is no step: it changes what stands, by at most one `Change` a property, by its index.

    As a step it has no verdicts, no number and no decision. `first` is the number of the row: as every row it takes as
    many numbers as there are properties. Its step has the times of the oldest event in `because`, the late
    events, of which it names the first `MOST_CAUSES` of `causes`. `standing` is what stands of whole steps, by the row
    (1, 2, 3…) at which each was said; of several revisions that are made together the first one has it.
    """

    first: int
    changes: tuple[Change | None, ...]
    because: tuple[Event, ...]
    causes: int
    standing: Mapping[int, Standing] = {}


def causes(events: tuple[Event, ...]) -> list[CauseRecord]:
    """Late events as plain data."""
    return [
        {"monitor": e.monitor, "seq": e.seq, "stream": e.stream.name, "kind": e.stream.kind, "stamp": e.stamp}
        for e in events
    ]


def revision_record(revision: Revision, change: Change) -> VerdictRecord:
    """The record of a change as plain data: that of a verdict, with what it `revises`."""
    step = revision.step
    return {
        "n": change.n,
        "step": None,
        "property": change.property,
        "order": revision.order,
        "outcome": None if change.outcome is None else change.outcome.value,
        "stream": "",
        "kind": "revision",
        "monitor": "",
        "seq": step.event.seq,
        "stamp": step.stamp,
        "arrived": step.event.arrived,
        "judged": revision.judged,
        "late": False,
        "skewed": False,
        "degraded": change.degraded,
        "decision": change.decision,
        "passed": None,
        "robustness": None,
        "violation": change.violation,
        "explanation": change.explanation,
        "pending": None,
        "about": [],
        "about_count": 0,
        "revises": {"from": change.first, "to": change.last},
        "retracted": change.retracted,
        "because": causes(revision.because),
        "causes": revision.causes,
    }
