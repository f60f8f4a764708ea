"""What a server sends, as models: they document and test the frames, which are built as plain data."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from oracle_server.core.events import Order, Released
from oracle_server.core.kinds import Kind, RecordKind, StepKind
from oracle_server.core.verdicts import Outcome
from oracle_server.wire.incoming import Incoming


class _Frame(BaseModel):
    model_config = ConfigDict(extra="forbid")


class StreamFrame(_Frame):
    """One stream to observe; durations in nanoseconds, `fields` the dotted paths that are read, null for all.

    `reads` are those that the spec itself names: what the type lacks of them is a mistake in one of both. Of an action
    there is one for each kind that the spec observes; `proxy`, `via` and `denied_result` are equal in all of them, and
    `action` is `filter` for the kinds that are asked.
    """

    name: str
    kind: Kind
    type: str
    action: Literal["log", "filter"]
    ordered: bool
    stamp: str | None
    latency: int
    fields: list[str] | None
    reads: list[str] | None = None
    on_unavailable: Literal["deny", "pass"] | None = None
    decide_within: int | None = None
    intercept: Literal["publisher", "subscriber"] | None = None
    proxy: str | None = None
    denied_response: dict[str, Any] | None = None
    via: Literal["proxy", "introspection"] | None = None
    denied_result: dict[str, Any] | None = None


class Limits(_Frame):
    """What the server takes; `max_frame` in bytes, `credit` the events that may be sent before the first `credit`."""

    max_frame: int
    max_batch: int
    max_outcomes: int
    max_depth: int
    credit: int


class AttachedFrame(_Frame):
    """The answer to `attach`; the monitor's numbers continue at `next`.

    Numbers below `first` are those of events of another process; 0 where no other was there.
    """

    type: Literal["attached"]
    monitor: str
    session: str
    spec: str
    spec_digest: str
    streams: list[StreamFrame]
    next: int
    first: int
    limits: Limits


class DecisionFrame(_Frame):
    """The answer to an event with `ask`, once it has been ordered and judged."""

    type: Literal["decision"]
    seq: int
    decision: Literal["allow", "deny"]
    denied_by: list[str]
    verdicts: dict[str, Outcome]


class AckFrame(_Frame):
    """Every event up to there is in the committed history, or refused."""

    type: Literal["ack"]
    upto: int


class CauseRecord(_Frame):
    """A late event that a revision was made for."""

    monitor: str
    seq: int
    stream: str
    kind: StepKind
    stamp: int | None


class RevisesRecord(_Frame):
    """The numbers of the first and the last verdict that a revision changes."""

    from_: int = Field(alias="from")
    to: int


class WaitedRecord(_Frame):
    """A stream of a monitor that an event waited for."""

    monitor: str
    stream: str
    kind: StepKind


class Record(BaseModel):
    """The verdict of one property at a step, or at a deadline that ran out (`kind` is `tick`); times in nanoseconds.

    Or, where `kind` is `revision`, what stands since then of a run of the property's verdicts.
    """

    n: int = Field(description="The number of the verdict in its session, without gaps")
    step: int | None = Field(description="The number of the step; null for ticks and events that were not judged")
    property: str
    order: Order
    outcome: Outcome | None = Field(description="Null for a revision that retracts what was said at deadlines")
    stream: str
    kind: RecordKind
    monitor: str
    seq: int
    stamp: int = Field(description="When the event was published")
    arrived: int = Field(description="When it came, in the session's time")
    judged: int = Field(description="When it was judged, in the server's time")
    late: bool
    skewed: bool
    degraded: bool
    decision: Literal["allow", "deny"] | None
    passed: bool | None = Field(description="Whether the adapter let an event pass that it asked about")
    robustness: float | Literal["Infinity", "-Infinity"] | None
    violation: bool = Field(description="Whether the property became negative here, or an obligation was not answered")
    explanation: dict[str, Any] | None
    pending: int | None = Field(description="Of a property that waits for what comes: how many obligations are open")
    about: list[dict[str, Any]] = Field(description="The events of those that were not answered here, 100 at most")
    about_count: int = Field(description="How many were not answered here")
    row: int | None = Field(None, description="Which element of its message it is of, from 0")
    released: Released | None = Field(None, description="Why the order of publication released the event")
    waited: list[WaitedRecord] | None = Field(
        None, description="The streams that it waited for last, 8 at most: they released it, or were behind it still"
    )
    place: int | None = Field(None, description="The place of a late event among the steps, where it was put in it")
    unheard: list[str] | None = Field(
        None, description="Streams that the property reads, and of which older events may still come"
    )
    revised: int | None = Field(None, description="The number of the revision by which it is as it stands")
    revises: RevisesRecord | None = Field(None, description="Which verdicts a revision changes")
    retracted: bool | None = Field(None, description="Whether the violation that a revision begins with does not stand")
    because: list[CauseRecord] | None = Field(None, description="Late events that a revision was made for, at most 10")
    causes: int | None = Field(None, description="How many late events those were in all")


class ViolationFrame(Record):
    """A verdict record at which a property became negative, after its commit; it may be a revision."""

    model_config = ConfigDict(extra="forbid")

    type: Literal["violation"]
    outcome: Outcome
    explanation: dict[str, Any]


class RevisionFrame(Record):
    """To monitors that attached with the feature `revisions`: the record of a revision, after its commit."""

    model_config = ConfigDict(extra="forbid")

    type: Literal["revision"]


class EpisodeFrame(_Frame):
    """To monitors that attached with the feature `episodes`, in place of `violation`: what became of an episode.

    Violations that follow each other closely are one. It has `begun`; or `ended`, since it can't go on any more; or it
    is `retracted`, since what came late leaves nothing of it. `moved`: another frame tells of the same with another
    beginning. Times are in nanoseconds; `last` and `until` are null while it is open, `explanation` is null but where
    it has begun.
    """

    type: Literal["episode"]
    event: Literal["begun", "ended", "retracted"]
    moved: bool
    session: str
    spec: str
    property: str
    order: Order
    first: int = Field(description="The n of the verdict that violates first")
    began: int = Field(description="Its time")
    last: int | None = Field(description="The n of the verdict that violates last")
    until: int | None = Field(description="Its time")
    open: bool
    final: bool
    count: int = Field(description="How many violations it is")
    worst: dict[str, Any] | None
    explanation: str | None


class EpisodeStanding(_Frame):
    """The episode of a property that is open, or may go on: the `n` of its first verdict, and the time of that (ns)."""

    first: int
    began: int
    open: bool
    final: bool
    count: int


class PropertyStanding(_Frame):
    """How one property stands; `level` and `text` are as in diagnostics, `first_violation` is a record's `n`.

    `first_violation_step` is that one's step, null for a deadline, and `first_violation_at` its stamp in nanoseconds.
    `episode` is the one that is open or may go on, null where there is none.
    """

    outcome: Outcome
    level: Literal["ok", "warn", "error", "stale"]
    text: str
    violations: int
    first_violation: int | None
    first_violation_step: int | None = None
    first_violation_at: int | None = None
    episode: EpisodeStanding | None = None


class VerdictsFrame(_Frame):
    """To monitors that attached with `verdicts`: once attached, and after each commit that changed something of it.

    It is as of the verdict `n`, in the order that decides; `worst` is the gravest outcome, `unknown` before any.
    """

    type: Literal["verdicts"]
    n: int
    worst: Outcome
    properties: dict[str, PropertyStanding]


class ErrorFrame(_Frame):
    """Something was refused; after a fatal error the server closes.

    `session` comes with `session_ended`: the one to attach to instead, missing where it is a new one without a name.
    `url` comes with `moved`: the server that has the session, missing where that is not known.
    """

    type: Literal["error"]
    code: str
    message: str
    fatal: bool
    seq: int | None = None
    session: str | None = None
    url: str | None = None


class CreditFrame(_Frame):
    """The monitor may send so many events more. Without credit it keeps its events; clocks and asks still go."""

    type: Literal["credit"]
    events: int


class DetachedFrame(_Frame):
    """All that the monitor sent is committed."""

    type: Literal["detached"]


Outgoing = Annotated[
    AttachedFrame
    | DecisionFrame
    | AckFrame
    | ViolationFrame
    | RevisionFrame
    | EpisodeFrame
    | VerdictsFrame
    | ErrorFrame
    | CreditFrame
    | DetachedFrame,
    Field(discriminator="type"),
]


def schema() -> dict[str, Any]:
    """The JSON Schema of both directions: `from_monitor` and `from_server`."""
    inputs = [
        ("from_monitor", "validation", TypeAdapter(Incoming)),
        ("from_server", "validation", TypeAdapter(Outgoing)),
    ]
    both, definitions = TypeAdapter.json_schemas(inputs, title="oracle.v1")  # type: ignore[arg-type]
    roots = {name: value for (name, _), value in both.items()}
    return {**definitions, "$defs": {**definitions["$defs"], **roots}}


if __name__ == "__main__":
    import json
    import sys

    json.dump(schema(), sys.stdout, indent=2, sort_keys=True)
    sys.stdout.write("\n")
