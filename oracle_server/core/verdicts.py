"""The judgement of an event: outcomes, verdicts, decisions, and verdict records."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Literal, TypedDict

import msgspec

from oracle_server.core.beyond import Beyond
from oracle_server.core.episode import Changes
from oracle_server.core.errors import one_line
from oracle_server.core.events import ENDED, Order, Source, Step
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.kinds import TICK
from oracle_server.core.naming import event_name, moment, step_name
from oracle_server.core.records import AboutRecord, ExplanationRecord, Number, VerdictRecord, WaitedRecord, WhyRecord


class Outcome(StrEnum):
    """How one property stands at one step; `TRUE` and `FALSE` are final, `UNKNOWN` is no judgement."""

    TRUE = "true"
    CURRENTLY_TRUE = "currently_true"
    CURRENTLY_FALSE = "currently_false"
    FALSE = "false"
    UNKNOWN = "unknown"

    __hash__ = str.__hash__  # an Enum's own is slow, and outcomes are hashed at each step

    @property
    def current(self) -> Outcome:
        """The same, not final."""
        return _CURRENT.get(self, self)


for _outcome in Outcome:  # Python 3.11 finds `Outcome.TRUE` by a function call, and a step names many
    type.__setattr__(Outcome, _outcome.name, _outcome)

_CURRENT = {Outcome.TRUE: Outcome.CURRENTLY_TRUE, Outcome.FALSE: Outcome.CURRENTLY_FALSE}

NEGATIVE = frozenset({Outcome.FALSE, Outcome.CURRENTLY_FALSE})
FINAL = frozenset({Outcome.TRUE, Outcome.FALSE})
_GRAVEST_FIRST = (Outcome.FALSE, Outcome.CURRENTLY_FALSE, Outcome.UNKNOWN, Outcome.CURRENTLY_TRUE, Outcome.TRUE)


def worst(outcomes: Iterable[Outcome]) -> Outcome:
    """The gravest of some outcomes, `UNKNOWN` of none; `UNKNOWN` is graver than what holds."""
    return min(outcomes, key=_GRAVEST_FIRST.index, default=Outcome.UNKNOWN)


Choice = Literal["allow", "deny"]
UNDECIDED = frozenset({"timeout", "unavailable"})
"""Why an adapter acted without a decision; the record of its event then has the kind `unavailable`."""


class Explanation(msgspec.Struct, frozen=True, gc=False):
    """Why a property is negative at a step: what formulas saw of the event, and the formula that it breaks.

    `text`, and `why` as plain data, are there where the engine explains its outcome.
    """

    formula: str
    signals: Mapping[str, Scalar]
    text: str | None = None
    why: WhyRecord | None = None
    about: tuple[AboutRecord, ...] = ()
    about_count: int = 0
    """The events that triggered obligations which were not answered, and how many they are."""


class Verdict(msgspec.Struct, frozen=True, gc=False):
    """How one property stands at one step; `n` counts a session's verdicts from 1 without gaps.

    `degraded`: something before it is known to be lost, skipped or failed, or a stream is bypassed at present;
    `bypassed`: that is the only reason. An explanation is there where the property became negative, and makes the
    verdict a violation. `robustness` is there where the engine measures it, `pending` where it has obligations;
    `beyond` are the values of the step by which the property is negative, where that is seen by them.
    """

    n: int
    property: str
    outcome: Outcome
    degraded: bool
    explanation: Explanation | None = None
    robustness: float | None = None
    bypassed: bool = False
    pending: int | None = None
    beyond: tuple[Beyond, ...] = ()


class Decision(msgspec.Struct, frozen=True, gc=False):
    """The answer to a monitor that asked: deny where a guarding property is negative or unknown, else allow."""

    choice: Choice
    denied_by: tuple[str, ...]


class Judged(msgspec.Struct, frozen=True, gc=False):
    """A step with its verdicts and decision.

    `number` counts the session's judged events, and is None for ticks, where the event was skipped as late, and where
    it was denied and taken back;
    `judged` is the time of judgement in nanoseconds; `decision` is None where nothing was asked. `place` is that of a
    late event which was put in its place among the steps, None where that is its number. `episodes` is what it does
    with the episodes of its properties.
    """

    step: Step
    number: int | None
    order: Order
    judged: int
    verdicts: tuple[Verdict, ...]
    decision: Decision | None
    place: int | None = None
    episodes: Changes = ()


class DecisionFrame(TypedDict):
    """The answer to an event with `ask`; `verdicts` are outcomes by the ids of the properties."""

    type: Literal["decision"]
    seq: int
    decision: Choice
    denied_by: list[str]
    verdicts: dict[str, str]


def record(judged: Judged, verdict: Verdict) -> VerdictRecord:
    """A record of the history as plain data, one per step and property."""
    step, event = judged.step, judged.step.event
    made: VerdictRecord = {
        "n": verdict.n,
        "step": judged.number,
        "property": verdict.property,
        "order": judged.order,
        "outcome": verdict.outcome.value,
        "stream": event.stream.name,
        "kind": event.stream.kind,
        "monitor": event.monitor,
        "seq": event.seq,
        "stamp": step.stamp,
        "arrived": event.arrived,
        "judged": judged.judged,
        "late": step.late,
        "skewed": step.skewed,
        "degraded": verdict.degraded,
        "decision": judged.decision.choice if judged.decision else None,
        "passed": None,
        "robustness": json_number(verdict.robustness),
        "violation": verdict.explanation is not None,
        "explanation": None,
        "pending": verdict.pending,
        "about": [],
        "about_count": 0,
    }
    if event.row is not None:
        made["row"] = event.row
    if step.released is not None:
        made["released"] = step.released
    if step.waited:
        made["waited"] = [waited_record(source) for source in step.waited]
    if judged.place is not None:
        made["place"] = judged.place
    return explained(made, explain(judged, verdict))


def waited_record(source: Source) -> WaitedRecord:
    """A stream that was waited for, as plain data."""
    monitor, stream = source
    return {"monitor": monitor, "stream": stream.name, "kind": stream.kind}


def explained(found: VerdictRecord, explanation: ExplanationRecord | None) -> VerdictRecord:
    """A record with an explanation; what that has of the record itself is moved there."""
    if explanation is None or "about" not in explanation:
        return {**found, "explanation": explanation}
    rest = explanation.copy()
    about, count = rest.pop("about"), rest.pop("about_count")
    return {**found, "explanation": rest, "about": about, "about_count": count}


def json_number(value: float | None) -> Number:
    """A number as JSON can represent it: infinities are the texts `Infinity` and `-Infinity`."""
    if value is None or math.isfinite(value):
        return value
    return "Infinity" if value > 0 else "-Infinity"


def explain(judged: Judged, verdict: Verdict) -> ExplanationRecord | None:
    """A verdict's explanation as plain data, None where it is no violation and none was asked for."""
    why, event = verdict.explanation, judged.step.event
    if why is None:
        return None
    if event.stream.kind == TICK:
        how_so = "the session ended" if event.source == ENDED else "a deadline ran out"
        where = f"when {how_so} at {moment(judged.step.stamp, exact=True)}"
    else:
        at = step_name(judged.number, judged.step.stamp)
        if judged.number is None:
            at = f"an attempt that was taken back ({at})"
        where = f"at {at}, {event_name(event.stream.name, event.stream.kind, event.seq, event.monitor, event.row)}"
        where += ", which came late" if judged.step.late else ""
    how = "does not hold" if verdict.outcome in NEGATIVE else "holds"
    if verdict.outcome is Outcome.UNKNOWN:
        how = "is not known to hold"
    found: ExplanationRecord = {
        "text": one_line(f"{verdict.property} {how} {where}: {why.text or why.formula}"),
        "formula": why.formula,
        "event": {
            "stream": event.stream.name,
            "kind": event.stream.kind,
            "monitor": event.monitor,
            "seq": event.seq,
            "stamp": judged.step.stamp,
            "signals": dict(why.signals),
        },
    }
    if event.row is not None:
        found["event"]["row"] = event.row
    if why.why:
        found = {**found, **why.why}
    if why.about_count:
        found["about"], found["about_count"] = list(why.about), why.about_count
    return found


def decision_frame(seq: int, decision: Decision, verdicts: Mapping[str, Outcome]) -> DecisionFrame:
    """The `decision` frame for a monitor that asked about its event number `seq`, as plain data."""
    return {
        "type": "decision",
        "seq": seq,
        "decision": decision.choice,
        "denied_by": list(decision.denied_by),
        "verdicts": {name: outcome.value for name, outcome in verdicts.items()},
    }
