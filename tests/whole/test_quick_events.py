"""Events are read in two ways, quickly and with words for what is wrong: both take the same, and read the same."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.wire.data import whole
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import (
    MAX_BATCH,
    ClockMessage,
    EventMessage,
    HandlingsMessage,
    QuickClock,
    QuickEvent,
    QuickHandlings,
)
from oracle_server.wire.reading import decode, event_in, event_of

PLAIN = {"type": "event", "seq": 1, "stream": "/a", "data": {}}
FIELDS: dict[str, list[Any]] = {
    "seq": [1, 0, -1, 2**53 - 1, 2**53, 1.0, "1", True, None, []],
    "stream": ["/a", "", "x" * 255, "x" * 256, 1, None, True],
    "kind": ["topic", "request", "response", "tick", "goals", "", None, 1],
    "stamp": [0, 1, 2**63 - 1, 2**63, -1, 1.5, 1.0, "1", True, None],
    "data": [{}, {"a": None}, {"a": [1, {"b": "c"}]}, [], None, "x", 1],
    "ask": [True, False, None, 0, 1, "true"],
    "source": ["", "x" * 255, "x" * 256, None, 1],
    "call": [0, 1, 2**53 - 1, 2**53, -1, 1.0, None, "1", True],
    "lost": [0, 1, 2**53 - 1, 2**53, -1, 1.0, None, "1", True],
    "type": ["event", "events", None, 1],
    "more": [1, {"x": "y"}],
}

GOAL = PLAIN | {"kind": "goal", "goal_id": "g"}
STATUS = PLAIN | {"kind": "status", "goal_id": "g", "status": "executing"}
MARKS: list[tuple[dict[str, Any], str, list[Any]]] = [
    (GOAL, "goal_id", ["", "x" * 255, "x" * 256, 1, True, []]),
    (STATUS, "goal_id", ["", "x" * 256, 1]),
    (STATUS, "status", ["accepted", "unknown", "done", "", 1, True]),
]
"""What events of actions have besides."""

frames = st.fixed_dictionaries(
    {"type": st.just("event"), "seq": st.just(7), "stream": st.just("/a"), "data": st.just({"v": 1})},
    optional={name: st.sampled_from(values) for name, values in FIELDS.items() if name not in PLAIN},
)


def told(event: EventMessage | QuickEvent) -> dict[str, Any]:
    plain = event.model_dump() if isinstance(event, EventMessage) else msgspec.structs.asdict(event)
    return {key: value for key, value in plain.items() if key != "type"}


def both(frame: dict[str, Any]) -> None:
    try:
        slow: Any = told(EventMessage.model_validate(frame))
    except ValueError:
        slow = None
    raw = msgspec.Raw(msgspec.json.encode(frame))
    for batched in (True, False):
        try:
            read = event_in(raw, whole) if batched else event_of(frame, 0)
            found: Any = told(read)
        except WireError:
            found = None
        assert found == slow, frame
    if frame.get("type", "event") == "event":
        try:
            alone: Any = decode(json.dumps({"type": "event"} | frame))
        except WireError:
            alone = None
        assert (told(alone) if alone else None) == slow, frame


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, values in FIELDS.items() for v in values])
def test_each_field(name: str, value: object) -> None:
    both(PLAIN | {name: value})


@pytest.mark.parametrize("name", [*PLAIN, "none"])
def test_a_missing_field(name: str) -> None:
    both({key: value for key, value in PLAIN.items() if key != name})


@pytest.mark.parametrize(("frame", "name", "value"), [(f, n, v) for f, n, values in MARKS for v in values])
def test_each_mark_of_a_goal(frame: dict[str, Any], name: str, value: object) -> None:
    both(frame | {name: value})


@settings(deadline=None)
@given(frames)
def test_any_fields(frame: dict[str, Any]) -> None:
    both(frame)


@pytest.mark.parametrize("separators", [(",", ":"), (", ", ": ")])
def test_however_it_is_written(separators: tuple[str, str]) -> None:
    frame = PLAIN | {"seq": 3, "data": {"v": 1}, "ask": True, "stamp": 1_732_147_200_000_000_000}
    event = decode(json.dumps(frame, separators=separators))
    assert isinstance(event, QuickEvent | EventMessage)
    assert told(event) == told(EventMessage.model_validate(frame))


OUTCOME = {"seq": 1, "passed": True, "why": "decision"}
STAMP = {"stream": "/a", "kind": "request", "stamp": 5}
ODD: list[Any] = [None, 0, -1, 1.0, 2**53, 2**63 - 1, 2**63, True, "x", "timeout", "topic", [], {}]


@pytest.mark.parametrize("name", ["seq", "passed", "why", "more"])
@pytest.mark.parametrize("value", ODD)
def test_each_field_of_an_outcome(name: str, value: object) -> None:
    as_slow(HandlingsMessage, {"type": "outcomes", "outcomes": [OUTCOME, OUTCOME | {name: value}]})


@pytest.mark.parametrize("name", ["stream", "kind", "stamp", "more"])
@pytest.mark.parametrize("value", ODD)
def test_each_field_of_a_clock(name: str, value: object) -> None:
    as_slow(ClockMessage, {"type": "clock", "stamps": [STAMP, STAMP | {name: value}]})


@pytest.mark.parametrize("outcomes", [None, {}, [OUTCOME] * MAX_BATCH, [OUTCOME] * (MAX_BATCH + 1)])
def test_no_more_outcomes_than_may_be_in_a_frame(outcomes: object) -> None:
    as_slow(HandlingsMessage, {"type": "outcomes", "outcomes": outcomes})


def as_slow(model: type[HandlingsMessage] | type[ClockMessage], frame: dict[str, Any]) -> None:
    try:
        slow: Any = model.model_validate(frame).model_dump()
    except ValueError:
        with pytest.raises(WireError):
            decode(json.dumps(frame, separators=(",", ":")))
        return
    read = decode(json.dumps(frame, separators=(",", ":")))
    assert isinstance(read, QuickHandlings | QuickClock | HandlingsMessage | ClockMessage)
    assert (
        read.model_dump() if isinstance(read, model) else {"type": frame["type"], **msgspec.to_builtins(read)}
    ) == slow
