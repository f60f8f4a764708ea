"""What a monitor may call the kind of an event: the kinds of streams, and no others."""

from __future__ import annotations

import json
from typing import get_args

import pytest

from oracle_server.core.kinds import KINDS, TICK, UNAVAILABLE
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import ClockMessage, EventMessage, QuickClock, QuickEvent
from oracle_server.wire.outgoing import StreamFrame
from oracle_server.wire.reading import decode

OF_STREAMS = [kind for kind, traits in KINDS.items() if traits.group]


def frames(kind: str) -> list[str]:
    """An event and a clock, each as it is read quickly and, with its type last, as it is read by the models."""
    event = {"type": "event", "seq": 1, "stream": "/x", "kind": kind, "data": {}}
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


def test_an_adapter_is_sent_streams_of_each_kind() -> None:
    assert set(get_args(StreamFrame.model_fields["kind"].annotation)) == set(OF_STREAMS)
