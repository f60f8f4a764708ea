"""Conversations for the tests, and frames to put into them."""

from __future__ import annotations

import json
from typing import Any, cast

from oracle_server.attach.conversation import Conversation, Received, State
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import AttachedFrame, Outgoing

ATTACHED = cast("AttachedFrame", {"type": "attached", "next": 1})
OVER = WireError("session_closed", "it was closed", fatal=True)


def written(frame: object, *, spaced: bool = False) -> str:
    """A frame as it is mostly written, or with blanks, for which it is read in another way."""
    return json.dumps(frame, separators=None if spaced else (",", ":"))


def event(seq: int, **fields: Any) -> dict[str, Any]:
    return {"type": "event", "seq": seq, "stream": "/a", "data": {}, **fields}


def both_ways(frame: object) -> list[str]:
    return [written(frame), written(frame, spaced=True)]


OUTCOME = {"seq": 1, "passed": True, "why": "decision"}
TEXTS: dict[str, list[str | bytes]] = {
    "attach": [written({"type": "attach", "monitor": "m", "instance": "i"})],
    "event": [*both_ways(event(1))],
    "bad event": [written(event(1, data=1)), written(event(1, stamp=-1))],
    "events": [*both_ways({"type": "events", "events": [event(1), event(2)]})],
    "events with a bad one": [written({"type": "events", "events": [event(1), event(2, data=1), 7, event(3)]})],
    "outcome": [written({"type": "outcome", **OUTCOME})],
    "outcomes": [*both_ways({"type": "outcomes", "outcomes": [OUTCOME]})],
    "clock": [*both_ways({"type": "clock", "stamps": [{"stream": "/a", "stamp": 1}]})],
    "report": [written({"type": "report", "streams": []})],
    "detach": ['{"type":"detach"}'],
    "no message": ["", "{", "7", '{"type":"later"}', '{"type":"attach"}', "[" * 100_000],
    "bytes": [b"", b"{}"],
}
"""Each kind of frame, in the ways in which it may come."""


def talk_in(state: State) -> Conversation:
    """A conversation that has come so far, and has nothing more to write."""
    talk = Conversation()
    if state is State.WAITING:
        return talk
    talk.receive(TEXTS["attach"][0])
    heard(talk)
    if state is not State.ATTACHING:
        talk.greet(ATTACHED, 0)
    if state is State.DETACHING:
        talk.receive(TEXTS["detach"][0])
        heard(talk)
    if state is State.ENDED:
        talk.drop(OVER)
    said(talk)
    return talk


def heard(talk: Conversation) -> list[Received]:
    """All messages that are there."""
    found = []
    while (message := talk.next_message()) is not None:
        found.append(message)
    return found


def said(talk: Conversation) -> list[Outgoing]:
    """All frames that are to be written."""
    found = []
    while (frame := talk.next_frame()) is not None:
        found.append(frame)
    return found


def words(frames: list[Outgoing]) -> list[str]:
    """Frames in short: an error as its code, others as their type."""
    return [frame["code"] if frame["type"] == "error" else frame["type"] for frame in frames]
