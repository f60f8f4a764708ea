"""What is told of a stored step: its verdict records, as they were said at first or as they stand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

from oracle_server.core.events import Step
from oracle_server.core.records import VerdictRecord
from oracle_server.core.revisions import Revision, Standing, revision_record
from oracle_server.core.verdicts import UNDECIDED, Judged, Verdict, explained, record
from oracle_server.history.records import StoredStep, recorded

View = Literal["standing", "first", "all"]
"""Which verdicts are told: those that stand, those that were said at first, or these and the revisions of them."""


def said(step: StoredStep, view: View) -> Standing:
    """What a step tells of the properties in a view: what stands at it where that is asked for, else what it said."""
    if view == "standing" and step.standing is not None:
        return step.standing
    return Standing(step.outcomes, step.degraded, step.explanations)


class Doubts(NamedTuple):
    """Which verdicts may still be revised, since a stream that they rest on was not heard beyond them.

    Those of steps at `since` (ns) or later; `readers` are the properties that rest on each topic or service.
    """

    since: int
    readers: Mapping[str, frozenset[int]]

    def of(self, step: Step, index: int) -> list[str]:
        """The streams that had not been heard beyond a step, and that a property (by its index) rests on."""
        if not step.unheard or step.time < self.since:
            return []
        return sorted(name for name in step.unheard if index in self.readers.get(name, ()))


def records(
    step: StoredStep, properties: tuple[str, ...], view: View = "first", doubts: Doubts | None = None
) -> list[VerdictRecord]:
    """The verdict records of a stored step in a view, one a property; none of a deadline that does not stand there.

    Of a revision, one for each of its changes, whatever the view.
    """
    first = (step.position - 1) * len(properties) + 1
    if step.revision is not None:
        revision = recorded(step, properties)
        assert isinstance(revision, Revision)  # noqa: S101 -- as the row has one
        return [revision_record(revision, change) for change in revision.changes if change is not None]
    judged = Judged(step.step, step.number, step.order, step.judged, (), step.decision, step.place)
    told = said(step, view)
    found = []
    for i, (name, outcome) in enumerate(zip(properties, told.outcomes, strict=True)):
        if outcome is None:
            continue
        robustness = step.robustness[i] if step.robustness else None
        verdict = Verdict(first + i, name, outcome, told.degraded[i], None, robustness, pending=step.pending.get(i))
        made = explained(record(judged, verdict), told.explanations.get(i))
        made["passed"], made["violation"] = step.passed, i in told.explanations
        if step.why in UNDECIDED:
            made["kind"] = "unavailable"
        if view == "standing" and i in step.revised:
            made["revised"] = step.revised[i]
        if doubts is not None and (unheard := doubts.of(step.step, i)):
            made["unheard"] = unheard
        found.append(made)
    return found
