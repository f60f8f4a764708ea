"""The conversations of tests/vectors, held with the real server."""

from __future__ import annotations

import contextlib
import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.whole.client import Monitor, connected
from tests.whole.harness import Server

VECTORS = sorted((Path(__file__).parents[1] / "vectors").glob("*.json"))
TURNS = ("monitor", "monitor_text", "monitor_breaks", "server", "server_closes")


def load(path: Path) -> Any:
    return json.loads(path.read_text())


def document(server: Server, path: str) -> Any:
    return server.http.get(path).json()


def matches(wanted: Any, found: Any) -> bool:
    """Whether a value is as a conversation has it."""
    match wanted:
        case "<text>":
            return isinstance(found, str) and found != ""
        case "<integer>":
            return type(found) is int
        case "<time>":
            return type(found) is int and found > 10**18
        case "<list>":
            return isinstance(found, list)
        case dict():
            return isinstance(found, dict) and all(
                key not in found if value == "<absent>" else key in found and matches(value, found[key])
                for key, value in wanted.items()
            )
        case list():
            return (
                isinstance(found, list)
                and len(found) == len(wanted)
                and all(matches(w, f) for w, f in zip(wanted, found, strict=True))
            )
    return type(wanted) is type(found) and bool(wanted == found)


class Conversation:
    """One side of a conversation, over any number of connections."""

    def __init__(self, server: Server, turns: list[dict[str, Any]]) -> None:
        self._server, self._turns = server, turns
        self._sockets = contextlib.AsyncExitStack()
        self._monitor: Monitor | None = None

    async def hold(self) -> None:
        async with self._sockets:
            for number, turn in enumerate(self._turns):
                (kind, content), *more = turn.items()
                assert not more, turn
                await self._take(number, kind, content)

    async def _take(self, number: int, kind: str, content: Any) -> None:
        monitor = self._monitor
        if monitor is None:
            monitor = self._monitor = await self._sockets.enter_async_context(connected(self._server))
        match kind:
            case "monitor":
                await monitor.send(content)
            case "monitor_text":
                await monitor.send_text(content)
            case "monitor_breaks":
                monitor.vanish()
                self._monitor = None
            case "server":
                await self._expect(monitor, number, content)
            case "server_closes":
                frames, code = await monitor.closed()
                assert [f for f in frames if f["type"] != "ack"] == []
                assert code == content
                self._monitor = None
            case _:
                pytest.fail(f"unknown turn {kind}")

    async def _expect(self, monitor: Monitor, number: int, wanted: dict[str, Any]) -> None:
        """Read the frame that comes next, and the acks that may come before it."""
        if wanted["type"] == "ack":
            while monitor.upto < wanted["upto"]:
                frame = await monitor.recv()
                assert frame["type"] == "ack", f"turn {number + 1}: expected {wanted}, got {frame}"
            assert monitor.upto == wanted["upto"]
            return
        frame = await monitor.recv()
        while frame["type"] == "ack":
            assert frame["upto"] <= self._most(number), f"turn {number + 1}: acked what was not sent yet: {frame}"
            frame = await monitor.recv()
        assert matches(wanted, frame), f"turn {number + 1}: expected {wanted}, got {frame}"

    def _most(self, number: int) -> int:
        """The next ack that is written."""
        acks = (turn["server"]["upto"] for turn in self._turns[number:] if turn.get("server", {}).get("type") == "ack")
        return next(acks, 2**53)


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
async def test_conversation(path: Path, server: Server) -> None:
    vector = load(path)
    await Conversation(server, vector["conversation"]).hold()
    for question in vector["then"]:
        await server.until(partial(document, server, question["get"]), partial(matches, question["body"]))


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_the_files_are_as_their_readme_says(path: Path) -> None:
    vector = load(path)
    assert set(vector) == {"about", "specs", "adapter", "conversation", "then"}
    assert all((path.parent / "specs" / f"{spec}.yaml").is_file() for spec in vector["specs"])
    assert {kind for turn in vector["conversation"] for kind in turn} <= set(TURNS)
    sent = [turn["monitor"] for turn in vector["conversation"] if "monitor" in turn]
    sessions = {frame["session"] for frame in sent if frame["type"] == "attach"}
    assert {s.replace("/", "_") for s in sessions} == {path.stem}
