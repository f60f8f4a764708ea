"""The frames that a server sends, as plain data with types; `outgoing.py` documents the same as models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NotRequired, TypedDict

from oracle_server.core.episode import EpisodeRecord
from oracle_server.core.kinds import Kind
from oracle_server.core.records import VerdictRecord
from oracle_server.core.verdicts import DecisionFrame


class StreamFrame(TypedDict):
    """One stream to observe; durations in nanoseconds."""

    name: str
    kind: Kind
    type: str
    action: Literal["log", "filter"]
    ordered: bool
    stamp: str | None
    latency: int
    fields: list[str] | None
    reads: NotRequired[list[str] | None]
    on_unavailable: NotRequired[Literal["deny", "pass"] | None]
    decide_within: NotRequired[int | None]
    intercept: NotRequired[Literal["publisher", "subscriber"] | None]
    proxy: NotRequired[str | None]
    denied_response: NotRequired[Mapping[str, Any] | None]
    via: NotRequired[Literal["proxy", "introspection"] | None]
    denied_result: NotRequired[Mapping[str, Any] | None]


class Limits(TypedDict):
    """What the server takes; `max_frame` in bytes."""

    max_frame: int
    max_batch: int
    max_outcomes: int
    max_depth: int
    credit: int


class AttachedFrame(TypedDict):
    """The answer to `attach`."""

    type: Literal["attached"]
    monitor: str
    session: str
    spec: str
    spec_digest: str
    streams: list[StreamFrame]
    next: int
    first: int
    limits: Limits


class AckFrame(TypedDict):
    """Every event up to there is committed, or refused."""

    type: Literal["ack"]
    upto: int


class ViolationFrame(VerdictRecord):
    """A verdict record at which a property became negative."""

    type: Literal["violation"]


class RevisionFrame(VerdictRecord):
    """The record of a revision."""

    type: Literal["revision"]


EpisodeEvent = Literal["begun", "ended", "retracted"]


class EpisodeFrame(EpisodeRecord):
    """An episode that has begun, or can't go on any more, or of which nothing stands.

    `moved`: another frame tells of the same with another beginning. `explanation` is there where it has begun.
    """

    type: Literal["episode"]
    event: EpisodeEvent
    moved: bool


class EpisodeStanding(TypedDict):
    """The episode of a property that is open, or may go on: the `n` of its first verdict, and the time of that (ns)."""

    first: int
    began: int
    open: bool
    final: bool
    count: int


Level = Literal["ok", "warn", "error", "stale"]


class PropertyStanding(TypedDict):
    """How one property stands; `first_violation_at` is in nanoseconds."""

    outcome: str
    level: Level
    text: str
    violations: int
    first_violation: int | None
    first_violation_step: NotRequired[int | None]
    first_violation_at: NotRequired[int | None]
    episode: NotRequired[EpisodeStanding | None]


class VerdictsFrame(TypedDict):
    """How all properties stand as of the verdict `n`."""

    type: Literal["verdicts"]
    n: int
    worst: str
    properties: dict[str, PropertyStanding]


class ErrorFrame(TypedDict):
    """Something was refused."""

    type: Literal["error"]
    code: str
    message: str
    fatal: bool
    seq: NotRequired[int]
    session: NotRequired[str]
    url: NotRequired[str]


class CreditFrame(TypedDict):
    """The monitor may send so many events more."""

    type: Literal["credit"]
    events: int


class DetachedFrame(TypedDict):
    """All that the monitor sent is committed."""

    type: Literal["detached"]


Outgoing = (
    AttachedFrame
    | DecisionFrame
    | AckFrame
    | ViolationFrame
    | RevisionFrame
    | EpisodeFrame
    | VerdictsFrame
    | ErrorFrame
    | CreditFrame
    | DetachedFrame
)
