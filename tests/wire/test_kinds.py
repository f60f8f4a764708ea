"""What a monitor may call the kind of an event: the kinds of streams, and no others."""

from __future__ import annotations

import json
from typing import get_args

import msgspec
import pytest

from oracle_server.core.kinds import KINDS, TICK, UNAVAILABLE
from oracle_server.wire.data import whole
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import ClockMessage, EventMessage, QuickClock, QuickEvent
from oracle_server.wire.outgoing import StreamFrame
from oracle_server.wire.reading import decode, event_in

OF_STREAMS = [kind for kind, traits in KINDS.items() if traits.group]


def frames(kind: str) -> list[str]:
    """An event and a clock, each as it is read quickly and, with its type last, as it is read by the models."""
    event = {"type": "event", "seq": 1, "stream": "/x", "kind": kind, "data": {}}
    event |= {"goal_id": "g", "status": "unknown"}
    clock = {"type": "clock", "stamps": [{"stream": "/x", "kind": kind, "stamp": 1}]}
    values = (event, clock, dict(reversed(event.items())), dict(reversed(clock.items())))
    return [json.dumps(value, separators=(",", ":")) for value in values]


@pytest.mark.parametrize("kind", OF_STREAMS)
def test_each_kind_of_a_stream_is_read(kind: str) -> None:
    for text in frames(kind):
        message = decode(text)
        if isinstance(message, EventMessage | QuickEvent):
            assert message.kind == kind
        else:
            assert isinstance(message, ClockMessage | QuickClock)
            assert message.stamps[0].kind == kind


@pytest.mark.parametrize("kind", [TICK, UNAVAILABLE, "requests", ""])
def test_what_only_records_have_as_a_kind_is_refused(kind: str) -> None:
    for text in frames(kind):
        with pytest.raises(WireError, match="kind"):
            decode(text)


def events(**head: object) -> list[str]:
    """An event as it is read quickly, as the models read it, and as the only one of a batch."""
    value = {"type": "event", "seq": 1, "stream": "/x", "data": {"status": 3}, **head}
    return [json.dumps(value), json.dumps(dict(reversed(value.items())))]


def read(text: str) -> QuickEvent:
    """The same as an event of a batch and alone."""
    message = decode(text)
    assert isinstance(message, QuickEvent)
    assert event_in(msgspec.Raw(text.encode()), whole) == message
    return message


def test_events_of_actions_have_the_id_of_their_goal_and_some_its_status() -> None:
    for text in events(kind="result", goal_id="", status="aborted"):
        assert (read(text).goal_id, read(text).status) == ("", "aborted")
    for text in events(kind="goal", goal_id="g" * 255, status="aborted"):
        assert (read(text).goal_id, read(text).status) == ("g" * 255, None), "a goal has no status"
    for text in events(kind="request", goal_id="g", status="aborted"):
        assert (read(text).goal_id, read(text).status) == (None, None), "nor has what is of no action an id"


@pytest.mark.parametrize(
    ("head", "reason"),
    [
        ({"kind": "goal"}, "goal_id"),
        ({"kind": "goal", "goal_id": None}, "goal_id"),
        ({"kind": "goal", "goal_id": 7}, "goal_id"),
        ({"kind": "goal", "goal_id": "g" * 256}, "goal_id"),
        ({"kind": "goal", "goal_id": "g", "status": "asleep"}, "status"),
        ({"kind": "reply", "goal_id": "g"}, "status"),
        ({"kind": "result", "goal_id": "g", "status": None}, "status"),
        ({"kind": "status", "goal_id": "g", "status": 3}, "status"),
    ],
)
def test_an_event_of_an_action_without_what_it_must_have_is_refused(head: dict[str, object], reason: str) -> None:
    for text in events(**head):
        with pytest.raises(WireError, match=reason) as refused:
            decode(text)
        assert (refused.value.code, refused.value.seq) == ("bad_event", 1)


def test_an_adapter_is_sent_streams_of_each_kind() -> None:
    assert set(get_args(StreamFrame.model_fields["kind"].annotation)) == set(OF_STREAMS)
