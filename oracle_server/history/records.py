"""What a history keeps, as values. Times are integer nanoseconds since the epoch."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple

import msgspec

from oracle_server.core.bypass import Bypass
from oracle_server.core.events import By, Event, Order, Step, StreamKey, TimeBase
from oracle_server.core.kinds import TICK
from oracle_server.core.records import ExplanationRecord
from oracle_server.core.revisions import Change, Revision, Standing
from oracle_server.core.verdicts import Decision, Judged, Outcome, Verdict, explain

Document = dict[str, Any]
Kind = Literal["robot", "recording"]
"""What a session judges: a robot by its monitors, or a recording."""


class SessionRecord(NamedTuple):
    """A session as it was opened.

    `text` is its spec's YAML, `properties` are their ids in the order of a step's outcomes; a `private` session is
    closed with its last monitor; `by` is the order that was asked for instead of the spec's. `begun` is when its first
    monitor attached, in the session's own time, None where none has, or where an older version kept it. `decides` is
    the order whose steps are decided by, `kind` what it judges.
    """

    number: int
    id: str
    spec: str
    text: str
    digest: str
    properties: tuple[str, ...]
    private: bool
    opened: int
    by: By | None = None
    begun: int | None = None
    decides: Order = "publication"
    kind: Kind = "robot"


class Elsewhere(NamedTuple):
    """Which server of those that share a history has a session open; `url` is where monitors reach it, if it is known.

    `here`: it is this one. `lasting`: its lease has not run out, so that it may judge; else another one takes over.
    `beside`: this one only reads the history of the other, a process of this machine. `own`: what a session that is
    forwarded from a robot is called there, if that is known.
    """

    node: str
    url: str | None
    here: bool
    lasting: bool
    beside: bool = False
    own: str | None = None


class Forwarding(NamedTuple):
    """Which history is forwarded, by a number of its own, and the last change of it that the centre has for sure."""

    robot: str
    seq: int


class Free(NamedTuple):
    """Up to which position the centre has a session's steps as they are, and what is deleted with them.

    `more`: something of it is not there yet.
    """

    session: int
    position: int
    more: bool


class PropertyStands(NamedTuple):
    """How a property of a session stands by what is committed: its outcome, and what is known of its violations.

    `degraded`: what was lost, skipped or failed may make it wrong for good; `bypassed`: it is degraded alone since
    messages went past a monitor.
    """

    property: str
    outcome: Outcome
    violations: int
    first_violation: int | None
    pending: int | None
    degraded: bool = False
    bypassed: bool = False


class OtherSession(NamedTuple):
    """A session that another server has open, by what is committed: how many steps it has, and its monitors.

    Of each of these it has the name, whether it is attached, and its clock. What `may_end` has no server any more by
    which it could be closed. `unjudged` says why it is not judged any more where it is open.
    """

    record: SessionRecord
    place: Elsewhere
    steps: int
    properties: list[PropertyStands]
    monitors: list[tuple[str, bool, TimeBase]]
    trouble: str | None = None
    may_end: bool = False
    unjudged: str | None = None


class MonitorRecord(NamedTuple):
    """A monitor of a session, the streams that it claimed, and those of them that are bypassed.

    `left` is when it was detached (ns); None where it is not, or where an older version kept it.
    """

    name: str
    instance: str
    streams: tuple[StreamKey, ...]
    attached: bool
    clock: TimeBase
    bypasses: Mapping[StreamKey, Bypass] = {}
    left: int | None = None


class Refusal(NamedTuple):
    """An event that could not be judged; `gap` are the sequence numbers before it that never came."""

    monitor: str
    seq: int
    gap: int
    at: int
    code: str
    message: str


class SnapshotRecord(NamedTuple):
    """A session as it stood after the step at `position`, as plain data.

    `numbers` are the monitors' sequence numbers as of `settled`: a restart needs no step up to there.
    """

    position: int
    data: Any
    settled: int = 0
    numbers: Mapping[str, Any] | None = None


class Extent(NamedTuple):
    """Which steps of a session are kept: from position `first` to `last`, where `last` < `first` if there are none.

    `closed` is None while it is open; of an open one, the steps up to `settled` are not needed to restore it.
    `beside` are the bytes that it takes beside its steps, about, and `refused` is how many refused events it has.
    `held`: a robot that forwards it, or did, has it open, and nobody here may delete of it.
    """

    number: int
    spec: str
    closed: int | None
    settled: int
    first: int
    last: int
    beside: int = 0
    refused: int = 0
    held: bool = False


class StoredRevision(msgspec.Struct, frozen=True, gc=False):
    """What a `Revision` changes, an entry a property, and the late events that it names of `causes`, as they are kept.

    What stands since then is kept with the steps that it revises.
    """

    changes: tuple[Change | None, ...]
    because: tuple[Event, ...]
    causes: int


class Restated(NamedTuple):
    """What stands of a step since revisions, and their numbers: by the property's index, that of the last one."""

    standing: Standing
    revised: Mapping[int, int]


class StoredStep(msgspec.Struct, frozen=True, gc=False):
    """A judged step as it is kept, without the event's data; or a revision, which takes its place in the sequence.

    `position` counts 1, 2, 3… in the sequence in which the session judged, over all orders; `number` is the step's own,
    None for ticks, where it was skipped and where it was taken back; `gap` are the sequence numbers before the event
    that never came; `judged` is the time of judgement. `outcomes` and `degraded` have an entry a property,
    `explanations` one for each violation, by the property's index; `bypassed` are the indexes of those degraded only
    because a stream was bypassed at the time; `pending` are the open obligations of properties that have any, by their
    indexes. `passed` and `why` are what the adapter did, None while it is not known.
    `place` is that of a late event which was put in its place among the steps. `standing` and `revised` are as in
    `Restated`, of a step that was revised. A `revision` has no outcomes of its own.
    """

    position: int
    order: Order
    number: int | None
    step: Step
    gap: int
    judged: int
    decision: Decision | None
    outcomes: tuple[Outcome, ...]
    degraded: tuple[bool, ...]
    explanations: Mapping[int, ExplanationRecord] = {}
    robustness: tuple[float | None, ...] | None = None
    passed: bool | None = None
    why: str | None = None
    bypassed: tuple[int, ...] = ()
    place: int | None = None
    standing: Standing | None = None
    revised: Mapping[int, int] = {}
    revision: StoredRevision | None = None
    pending: Mapping[int, int] = {}

    @property
    def lost(self) -> bool:
        """Whether all verdicts are degraded by what was known to be lost or skipped."""
        return all(self.degraded) and not self.bypassed

    @property
    def is_tick(self) -> bool:
        """Whether it is a deadline that ran out, and no event."""
        return self.step.event.stream.kind == TICK

    @property
    def tells_violations(self) -> bool:
        """Whether any violation was said, appeared or is retracted by it, or stands at it."""
        if self.revision is not None:
            return any(c is not None and (c.violation or c.retracted) for c in self.revision.changes)
        return bool(self.explanations or (self.standing is not None and self.standing.explanations))


def stored(position: int, gap: int, judged: Judged, handling: tuple[bool, str] | None = None) -> StoredStep:
    """A judged step as it is kept; `handling` is what the adapter did and why, where that is known already."""
    verdicts = judged.verdicts
    whys, robustness = [v.explanation for v in verdicts], [v.robustness for v in verdicts]
    explanations: dict[int, ExplanationRecord] = {}
    if any(whys):
        found = ((i, explain(judged, v)) for i, v in enumerate(verdicts))
        explanations = {i: why for i, why in found if why is not None}
    passed, why = handling or (None, None)
    return StoredStep(
        position, judged.order, judged.number, judged.step, gap, judged.judged, judged.decision,
        tuple([v.outcome for v in verdicts]), tuple([v.degraded for v in verdicts]), explanations,
        None if robustness.count(None) == len(robustness) else tuple(robustness), passed, why,
        tuple([i for i, v in enumerate(verdicts) if v.bypassed]), judged.place,
        pending={i: v.pending for i, v in enumerate(verdicts) if v.pending is not None},
    )  # fmt: skip


def stored_revision(position: int, revision: Revision) -> StoredStep:
    """A revision as it is kept, as the row at a position."""
    kept = StoredRevision(revision.changes, tuple([_named(event) for event in revision.because]), revision.causes)
    return StoredStep(
        position, revision.order, None, revision.step, 0, revision.judged, None, (), (), revision=kept
    )  # fmt: skip


def _named(event: Event) -> Event:
    """What is kept of a late event with a revision: the rest of it has a row of its own."""
    return Event(event.stream, event.monitor, event.seq, event.stamp, event.arrived, None)


def restated(revisions: Iterable[Revision]) -> dict[int, Restated]:
    """What stands of steps since some revisions in a row, by their positions."""
    standing: dict[int, Standing] = {}
    revised: defaultdict[int, dict[int, int]] = defaultdict(dict)
    passed: Mapping[int, Standing] = {}
    for revision in revisions:
        passed = revision.standing or passed
        standing |= revision.standing
        width = len(revision.changes)
        for i, change in enumerate(revision.changes):
            if change is not None:
                positions = range((change.first - 1) // width + 1, (change.last - 1) // width + 2)
                for position in filter(passed.__contains__, positions):
                    revised[position][i] = change.n
    return {position: Restated(stands, revised[position]) for position, stands in standing.items()}


def recorded(stored: StoredStep, properties: tuple[str, ...]) -> Judged:
    """A stored row as it was judged, or rather as it stands; a revision without what it changes in other rows."""
    first, revision = (stored.position - 1) * len(properties) + 1, stored.revision
    if revision is not None:
        return Revision(
            step=stored.step, number=None, order=stored.order, judged=stored.judged, verdicts=(), decision=None,
            first=first, changes=revision.changes, because=revision.because, causes=revision.causes,
        )  # fmt: skip
    stands = stored.standing
    outcomes, degraded = (stored.outcomes, stored.degraded) if stands is None else (stands.outcomes, stands.degraded)
    verdicts = [
        Verdict(
            first + i,
            name,
            outcomes[i] or Outcome.UNKNOWN,
            degraded[i],
            bypassed=i in stored.bypassed,
            pending=stored.pending.get(i),
        )
        for i, name in enumerate(properties)
    ]
    return Judged(
        stored.step, stored.number, stored.order, stored.judged, tuple(verdicts), stored.decision, stored.place
    )
