"""The `violation` frame is a verdict record with a type: its documentation and its making hold together."""

from __future__ import annotations

import msgspec

from oracle_server.core.events import Event
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.plan import plan
from oracle_server.core.records import VerdictRecord
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, Spec, StreamSpec
from oracle_server.core.verdicts import record
from oracle_server.engines.native import NativeEngine
from oracle_server.wire.outgoing import ViolationFrame

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
    assert VerdictRecord.__required_keys__ == ViolationFrame.model_fields.keys() - {"type"}
    assert not VerdictRecord.__optional_keys__


def test_a_record_of_a_violation_is_what_both_say() -> None:
    (row,) = violations()
    assert list(row) == [name for name in ViolationFrame.model_fields if name != "type"]
    frame = ViolationFrame.model_validate_json(msgspec.json.encode({"type": "violation", **row}), strict=True)
    assert (frame.step, frame.property, frame.decision, frame.violation) == (2, "p", "deny", True)
    assert msgspec.convert(row, VerdictRecord) == row, "explanations have no key that their type does not know"
