"""One side of the wire, and short words for what both sides do to it."""

from __future__ import annotations

import json
from typing import Any, Dict, List, Union

from oracle_adapter import Answer
from oracle_adapter.notices import Answered
from oracle_adapter.protocol import Hello, Protocol
from oracle_adapter.queued import Queued

Frame = Dict[str, Any]


class Side:
    """A protocol, and short words for what both sides do to it."""

    def __init__(self, capacity: int = 100, **hello: Any) -> None:
        self.protocol = Protocol(Hello("uav1", "i1", **hello), capacity)

    def attach(self, upcoming: int = 1, **fields: Any) -> List[Any]:
        answer = {
            "monitor": "uav1",
            "session": "s1",
            "spec": "battery",
            "spec_digest": "d1",
            "streams": [{"name": "/a", "kind": "topic"}],
            "next": upcoming,
            "limits": {},
        }
        return self.receive("attached", **{**answer, **fields})

    def receive(self, type_: str, **fields: Any) -> List[Any]:
        self.protocol.receive(json.dumps({"type": type_, **fields}))
        return self.protocol.take_notices()

    def send(self, *values: Any) -> List[bool]:
        return [self.protocol.send(None, f'"data":{json.dumps(value)}}}') for value in values]

    def ask(self, value: Any = "ask") -> Union[Queued, Answer]:
        return self.protocol.ask(None, f'"ask":true,"data":{json.dumps(value)}}}')

    def queued(self, value: Any = "ask") -> Queued:
        event = self.ask(value)
        assert isinstance(event, Queued)
        return event

    def frames(self) -> List[Frame]:
        return [json.loads(text) for text in iter(self.protocol.next_frame, None)]

    def events(self) -> List[Frame]:
        found: List[Frame] = []
        for frame in self.frames():
            found += frame["events"] if frame["type"] == "events" else [frame]
        return found

    def numbers(self) -> List[int]:
        return [event["seq"] for event in self.events()]

    def reconnect(self, upcoming: int, **fields: Any) -> List[Any]:
        self.protocol.disconnected()
        return self.attach(upcoming, **fields)


def answer_in(notices: List[Any]) -> Answer:
    (notice,) = notices
    assert isinstance(notice, Answered)
    return notice.answer
