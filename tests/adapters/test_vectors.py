"""The adapter's side of the conversations in tests/vectors: told to do what the monitor does, it says the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from oracle_adapter.notices import Answered
from oracle_adapter.protocol import Hello, Protocol

Frame = dict[str, Any]
FOLDER = Path(__file__).parents[1] / "vectors"
STANDS_FOR = {"<text>": "text", "<integer>": 2**20, "<time>": 1732147200000000000, "<list>": []}
VECTORS = [path for path in sorted(FOLDER.glob("*.json")) if json.loads(path.read_text(encoding="utf-8"))["adapter"]]


def sent(frame: Any) -> Any:
    """A server's frame as it could be, with values for the texts that stand for some."""
    if isinstance(frame, dict):
        return {key: sent(value) for key, value in frame.items() if value != "<absent>"}
    if isinstance(frame, list):
        return [sent(value) for value in frame]
    return STANDS_FOR.get(frame, frame) if isinstance(frame, str) else frame


def matches(wanted: Frame, said: Frame) -> bool:
    """Whether a frame says what is written; keys that are not written are free."""
    if wanted["type"] == "events" and said["type"] == "events":
        pairs = zip(wanted["events"], said["events"], strict=True)
        return all(matches({"type": "event", **w}, s) for w, s in pairs)
    return all(said.get(key) == value for key, value in wanted.items())


class Adapter:
    """One monitor's side of a conversation, over all its connections."""

    def __init__(self, attach: Frame) -> None:
        streams = attach.get("streams")
        hello = {key: attach.get(key) for key in ("session", "spec", "verdicts")}
        names = None if streams is None else tuple(streams)
        features = tuple(attach["features"]) if "features" in attach else None
        clock = attach.get("clock", "wall")
        self.protocol = Protocol(
            Hello(attach["monitor"], attach["instance"], streams=names, clock=clock, features=features, **hello), 100
        )
        self.answers: dict[int, Any] = {}
        self.unsaid: list[Frame] = []

    def do(self, frame: Frame) -> None:
        """Do what makes a monitor say this frame."""
        match frame["type"]:
            case "attach":
                self.unsaid.append(json.loads(self.protocol.hello()))
            case "event":
                head = {"stream": frame["stream"], "kind": frame.get("kind", "topic"), "ask": frame.get("ask", False)}
                more = {key: frame[key] for key in ("source", "call") if key in frame}
                body = json.dumps({**head, **more, "data": frame["data"]})[1:]
                queue = self.protocol.ask if frame.get("ask") else self.protocol.send
                queue(frame.get("stamp"), body, frame.get("lost", 0))
            case "events":
                for event in frame["events"]:
                    self.do({"type": "event", **event})
            case "clock":
                self.protocol.clock([(s["stream"], s.get("kind", "topic"), s["stamp"]) for s in frame["stamps"]])
            case "outcome":
                self.protocol.handled(self.answers[frame["seq"]], frame["passed"], frame["why"])
            case "outcomes":
                for told in frame["outcomes"]:
                    self.protocol.handled(self.answers[told["seq"]], told["passed"], told["why"])
            case "detach":
                self.protocol.detach()

    def says(self) -> Frame:
        """The next frame that goes out."""
        if not self.unsaid:
            text = self.protocol.next_frame()
            assert text is not None, "the adapter has nothing to say"
            self.unsaid.append(json.loads(text))
        return self.unsaid.pop(0)

    def hears(self, frame: Frame) -> None:
        """Take in a frame of the server's."""
        self.protocol.receive(json.dumps(sent(frame)))
        for notice in self.protocol.take_notices():
            if isinstance(notice, Answered):
                self.answers[notice.answer.seq or 0] = notice.answer


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_the_adapter_says_what_is_written(path: Path) -> None:
    turns = json.loads(path.read_text(encoding="utf-8"))["conversation"]
    adapters: dict[str, Adapter] = {}
    current = ""
    said = 0
    for turn in turns:
        if "monitor" in turn:
            frame = turn["monitor"]
            if frame["type"] == "attach":
                current = frame["monitor"] + frame["instance"]
                adapters.setdefault(current, Adapter(frame))
            adapters[current].do(frame)
            assert matches(frame, adapters[current].says()), frame
            said += 1
        elif "server" in turn:
            adapters[current].hears(turn["server"])
        else:
            adapters[current].protocol.disconnected()
    assert said


def test_there_are_conversations_for_the_adapter() -> None:
    assert len(VECTORS) > 8
