"""Verdict records as plain data: what the history keeps of a verdict, and what is sent and shown of it."""

from __future__ import annotations

from typing import Literal, NotRequired, TypedDict

from oracle_server.core.events import Order, Released
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.kinds import RecordKind, StepKind

Number = float | Literal["Infinity", "-Infinity"] | None
"""A number as JSON can represent it, None where there is none."""


class EventRecord(TypedDict):
    """An event in an explanation; `signals` are what formulas saw of it, `stamp` is in nanoseconds.

    `step` is its number, in reasons only, and not of an attempt that was taken back. `row` is there where it stands for
    an element of its message.
    """

    step: NotRequired[int]
    row: NotRequired[int]
    stream: str
    kind: StepKind
    stamp: int
    monitor: str
    seq: int
    signals: dict[str, Scalar]


class AboutRecord(EventRecord):
    """The event that triggered an obligation which was not answered, and the `values` of its variables."""

    values: dict[str, Scalar]


class FailingRecord(TypedDict):
    """A constraint that a step did not meet: the signal, its value, and what was wanted, compared by `op`.

    `value` is None where the signal is `missing`: absent, or not computed. `wanted` is None for any other value; it is
    the value of the signal `than`, where there is one.
    """

    signal: str
    op: str
    wanted: Scalar | None
    value: Scalar | None
    missing: NotRequired[Literal["absent", "failed"]]
    than: NotRequired[str]


class ReasonRecord(TypedDict):
    """One part of a formula in an explanation: whether it holds, and what decides it.

    `at` is the step that decides it, as a number or as a time in nanoseconds; an attempt that was taken back has no
    number. `event` is its event, None where that is not known any more. `window` has the first and the last of several
    such steps. `failing` are the constraints of an atom that fail at the step. `reasons` are the part's own parts.
    """

    formula: str
    holds: bool
    text: str
    at: NotRequired[int]
    event: NotRequired[EventRecord | None]
    window: NotRequired[list[int]]
    failing: NotRequired[list[FailingRecord]]
    reasons: NotRequired[list[ReasonRecord]]


class WhyRecord(TypedDict):
    """Why a formula holds or does not: the `values` of its variables that decide it, None for any not seen yet."""

    values: dict[str, Scalar | None]
    other_values: int
    reasons: list[ReasonRecord]


class ExplanationRecord(TypedDict):
    """An explanation; what `WhyRecord` has is there where the engine can say more.

    `about` and `about_count` are those of the record, which the history keeps here.
    """

    text: str
    formula: str
    event: EventRecord
    values: NotRequired[dict[str, Scalar | None]]
    other_values: NotRequired[int]
    reasons: NotRequired[list[ReasonRecord]]
    about: NotRequired[list[AboutRecord]]
    about_count: NotRequired[int]


class CauseRecord(TypedDict):
    """A late event that a revision was made for; `stamp` is in nanoseconds."""

    monitor: str
    seq: int
    stream: str
    kind: StepKind
    stamp: int | None


RevisesRecord = TypedDict("RevisesRecord", {"from": int, "to": int})
"""The numbers of the first and the last verdict that a revision changes."""


class WaitedRecord(TypedDict):
    """A stream of a monitor that an event waited for."""

    monitor: str
    stream: str
    kind: StepKind


class VerdictRecord(TypedDict):
    """The verdict of one property at one step; `stamp`, `arrived` and `judged` are in nanoseconds.

    `step` is None for ticks, skipped events and attempts that were taken back, `decision` and `passed` where no
    decision was asked for, `explanation` where the verdict is no violation and none was asked for.

    Of a property that waits for what comes, `pending` is how many of its obligations are open, else None; `about` has
    the events of those that were not answered here, 100 at most, and `about_count` is how many they are.

    `row` is which element of its message the event stands for, from 0, missing where that is a step as a whole.

    `released` is why the order of publication released the event, missing where it was not in that order, and `waited`
    the streams that it waited for last, missing where it did not wait for any. Of specs that revise: `place` is the
    step's place in what stood at the record, `unheard` the streams that the property reads and that had not been heard
    beyond the step, while they may still be; `revised` is the number of the revision by which the record is as it
    stands. A revision (`kind`) has `revises`; its `outcome` is None where those are retracted.
    """

    n: int
    step: int | None
    property: str
    order: Order
    outcome: str | None
    stream: str
    kind: RecordKind
    monitor: str
    seq: int
    stamp: int
    arrived: int
    judged: int
    late: bool
    skewed: bool
    degraded: bool
    decision: Literal["allow", "deny"] | None
    passed: bool | None
    robustness: Number
    violation: bool
    explanation: ExplanationRecord | None
    pending: int | None
    about: list[AboutRecord]
    about_count: int
    row: NotRequired[int]
    released: NotRequired[Released]
    waited: NotRequired[list[WaitedRecord]]
    place: NotRequired[int]
    unheard: NotRequired[list[str]]
    revised: NotRequired[int]
    revises: NotRequired[RevisesRecord]
    retracted: NotRequired[bool]
    because: NotRequired[list[CauseRecord]]
    causes: NotRequired[int]
