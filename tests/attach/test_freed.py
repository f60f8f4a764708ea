"""What a connection held is free once it has ended: garbage is not looked for in what has lived for long."""

from __future__ import annotations

import asyncio
import gc
import json
import socket
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from starlette.websockets import WebSocket
from uvicorn.server import ServerState
from websockets.asyncio.client import connect

from oracle_server.attach.connection import Connection
from oracle_server.attach.conversation import Conversation
from oracle_server.edge import transport
from oracle_server.edge.listener import Listener
from oracle_server.edge.tokens import Grant
from oracle_server.edge.transport import HttpTransport, WebSocketTransport, http_transport
from oracle_server.edge.visitors import Visitor, Visitors
from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.registry import Registry
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, registry

PARTS = (LiveSession, Connection, Conversation, HttpTransport, WebSocketTransport, Visitor)


@pytest.fixture
def uncollected() -> Iterator[None]:
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.fixture
async def serving(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[tuple[Registry, str]]:
    """The sessions of a server that takes connections as the real one does, and its address."""
    monkeypatch.setattr(transport, "_CLOSE_WITHIN", 0.0)  # until then a timer keeps the connection
    history = MemoryHistory()
    sessions = registry(history, tmp_path, GUARD)

    async def serve(scope: Any, receive: Any, send: Any) -> None:
        scope["state"]["grant"] = Grant(frozenset({"submit"}))
        await Connection(WebSocket(scope, receive, send), sessions).serve()

    config = uvicorn.Config(serve, interface="asgi3", ws=WebSocketTransport, log_config=None, lifespan="off")
    config.load()
    visitors, state = Visitors(10), ServerState()
    made = http_transport(visitors)
    listener = Listener(visitors, socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.bind(("127.0.0.1", 0))
    loop = asyncio.get_running_loop()
    listening = await loop.create_server(lambda: made(config, state, {}), sock=listener)
    try:
        async with asyncio.timeout(PATIENCE):
            yield sessions, f"ws://127.0.0.1:{listener.getsockname()[1]}/"
    finally:
        listening.close()
        history.close()


async def say(url: str, sessions: Registry, *, leave: bool) -> None:
    """Attach, ask for a decision, and leave; else let the server close the session."""
    async with connect(url) as client:
        await client.send(
            json.dumps({"type": "attach", "monitor": "m", "instance": "i", "session": "s", "spec": "guard"})
        )
        await client.send(json.dumps({"type": "event", "seq": 1, "stream": "/go", "data": {"speed": 4}, "ask": True}))
        if leave:
            await client.send(json.dumps({"type": "detach"}))
        kinds = []
        while "ack" not in kinds:
            kinds.append(json.loads(await client.recv())["type"])
        assert "decision" in kinds
        await sessions.closed_within(sessions.open["s"], PATIENCE)
        await client.wait_closed()


def living() -> Counter[type]:
    return Counter(type(one) for one in gc.get_objects() if issubclass(type(one), PARTS))


@pytest.mark.usefixtures("uncollected")
@pytest.mark.parametrize("leave", [True, False], ids=["it leaves", "the session is closed"])
async def test_a_connection_that_has_ended_is_free_without_a_collection(
    serving: tuple[Registry, str], *, leave: bool
) -> None:
    sessions, url = serving
    before = living()
    await say(url, sessions, leave=leave)
    async with asyncio.timeout(PATIENCE):
        while living() != before:
            await asyncio.sleep(0.01)
