"""The frames `violation` and `revision` are records with a type: their documentation and their making hold together."""

from __future__ import annotations

from typing import NotRequired, get_origin, get_type_hints

import msgspec

from oracle_server.core.events import REVISIONS, Event, Step, StreamKey
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.plan import plan
from oracle_server.core.records import VerdictRecord
from oracle_server.core.revisions import Change, Revision, revision_record
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, Spec, StreamSpec
from oracle_server.core.verdicts import Outcome, record
from oracle_server.engines.native import NativeEngine
from oracle_server.wire.outgoing import RevisionFrame, ViolationFrame

FORMULA = "historically forall[i]. {x: *i} -> once {y: *i}"


def violations() -> list[VerdictRecord]:
    """The records of a session with one violation, at its second step, which asks."""
    stream = StreamSpec("/a", signals={"x": "msg.x", "y": "msg.y"}, action="filter")
    formula = parse_formula(FORMULA, "steps")
    spec = Spec("s", (stream,), (Property("p", formula, FORMULA, guards=frozenset({"/a"})),))
    session = Session(plan(spec), [[NativeEngine(formula)]])
    session.attach("m", [stream.key], 0)
    events = [Event(stream.key, "m", i, i, i, data, ask=i == 2) for i, data in enumerate(({"y": 1}, {"x": 2}), start=1)]
    judged = [judged for event in events for judged in session.ingest(event)]
    return [record(j, v) for j in judged for v in j.verdicts if v.explanation]


def test_a_record_has_the_fields_of_the_documented_frame_and_no_others() -> None:
    fields = {name: field.is_required() for name, field in ViolationFrame.model_fields.items() if name != "type"}
    hints = get_type_hints(VerdictRecord, include_extras=True)
    assert fields == {name: get_origin(hint) is not NotRequired for name, hint in hints.items()}


def test_a_record_of_a_violation_is_what_both_say() -> None:
    (row,) = violations()
    fields = ViolationFrame.model_fields.items()
    assert list(row) == [name for name, field in fields if name != "type" and (field.is_required() or name in row)]
    frame = ViolationFrame.model_validate_json(msgspec.json.encode({"type": "violation", **row}), strict=True)
    assert (frame.step, frame.property, frame.decision, frame.violation) == (2, "p", "deny", True)
    assert msgspec.convert(row, VerdictRecord) == row, "explanations have no key that their type does not know"


def revised(outcome: Outcome | None, *, violation: bool) -> VerdictRecord:
    """The record of a revision, made for a late event."""
    late = Event(StreamKey("/a", "topic"), "m", 17, 30, 500, {})
    change = Change(9, "p", 2, 4, outcome, degraded=False, violation=violation, retracted=not violation)
    if violation:
        change = Change(
            9, "p", 2, 4, outcome, degraded=False, violation=True, explanation=violations()[0]["explanation"]
        )
    row = Revision(
        Step(Event(REVISIONS, "", -1, 30, 500, {}), {}, frozenset(), 30), None, "publication", 501, (), None,
        first=9, changes=(change,), because=(late,), causes=12,
    )  # fmt: skip
    return revision_record(row, change)


def test_a_record_of_a_revision_is_what_both_say() -> None:
    row = revised(None, violation=False)
    frame = RevisionFrame.model_validate_json(msgspec.json.encode({"type": "revision", **row}), strict=True)
    assert frame.revises is not None
    assert (frame.kind, frame.outcome, frame.revises.from_, frame.revises.to) == ("revision", None, 2, 4)
    assert (frame.because or [])[0].seq == 17
    assert msgspec.convert(row, VerdictRecord) == row


def test_a_violation_that_appears_by_a_revision_is_a_violation_frame() -> None:
    row = revised(Outcome.CURRENTLY_FALSE, violation=True)
    frame = ViolationFrame.model_validate_json(msgspec.json.encode({"type": "violation", **row}), strict=True)
    assert (frame.n, frame.violation, frame.causes) == (9, True, 12)
