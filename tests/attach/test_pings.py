"""Signs of life over a connection that is not read while its session rests."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from starlette.websockets import WebSocket
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState
from websockets.asyncio.client import ClientConnection, connect

from oracle_server.attach.connection import Connection
from oracle_server.edge.slices import MOST
from oracle_server.edge.tokens import Grant
from oracle_server.edge.transport import WebSocketTransport
from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.shares import Shares
from tests.attach.test_resting import Machine
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, registry

_NEVER = 10_000.0


class Talk:
    """A monitor that is attached over a real socket, and the server's end of that, which pings when it is told to."""

    def __init__(self, sessions: Registry, shares: Shares, machine: Machine) -> None:
        self.sessions, self.shares, self.machine = sessions, shares, machine
        self.transport: WebSocketTransport
        self.client: ClientConnection
        self._other = shares.share()

    async def serve(self, scope: Any, receive: Any, send: Any) -> None:
        scope.setdefault("state", {})["grant"] = Grant(frozenset({"submit"}))
        self.transport = scope["extensions"]["oracle.direct"]
        await Connection(WebSocket(scope, receive, send), self.sessions).serve()

    async def hears(self, kind: str) -> dict[str, Any]:
        while (frame := json.loads(await self.client.recv()))["type"] != kind:
            pass
        return dict(frame)

    async def asks(self, seq: int) -> None:
        frame = {"type": "event", "seq": seq, "stream": "/go", "data": {"speed": seq}, "ask": True}
        await self.client.send(json.dumps(frame))

    async def begin(self) -> None:
        wanted = {"type": "attach", "monitor": "m", "instance": "i", "session": "s", "spec": "guard"}
        await self.client.send(json.dumps(wanted))
        await self.hears("attached")

    async def rest(self) -> None:
        """Let the session rest, and send so much meanwhile that the socket is not read."""
        self.machine.dear = 0.003
        self._other.run(lambda: None)
        await self.asks(1)
        await self.hears("decision")
        self.machine.dear = 0.0
        assert self.sessions.open["s"].share.rest > 0
        for seq in (2, 3):
            await self.asks(seq)
            while not self.transport.read_paused:
                await asyncio.sleep(0)
            if seq == 2:  # the reader takes it, and waits; what comes next stays unread
                while self.transport.read_paused:
                    await asyncio.sleep(0)

    def ping(self) -> None:
        """Send a ping as the server does each 5 s."""
        assert self.transport.ping_timer is not None
        self.transport.ping_timer.cancel()
        self.transport.send_keepalive_ping()

    def time_out(self) -> None:
        """Let the time for the answer run out."""
        assert self.transport.pong_timer is not None
        self.transport.pong_timer.cancel()
        self.transport.keepalive_timeout()

    def look(self) -> None:
        """Let the time run out after which something is read although the session rests."""
        if self.transport._next is not None:
            self.transport._next.cancel()
            self.transport._look()

    async def go_on(self) -> None:
        self.machine.now += 10
        for seq in (2, 3):
            assert (await self.hears("decision"))["seq"] == seq

    async def answered(self) -> None:
        """Wait for the answer to the last ping."""
        while self.transport.pending_ping_payload is not None:
            await asyncio.sleep(0)


@asynccontextmanager
async def attached(folder: Path) -> AsyncIterator[Talk]:
    machine, history = Machine(), MemoryHistory()
    shares = Shares(lambda: machine.now, machine.look)
    talk = Talk(registry(history, folder, GUARD, shares=shares), shares, machine)
    config = uvicorn.Config(
        talk.serve,
        interface="asgi3",
        ws=WebSocketTransport,
        log_config=None,
        ws_ping_interval=_NEVER,
        ws_ping_timeout=_NEVER,
        lifespan="off",
    )
    config.load()
    state = ServerState()
    listening = await asyncio.get_running_loop().create_server(lambda: H11Protocol(config, state, {}), "127.0.0.1", 0)
    port = listening.sockets[0].getsockname()[1]
    try:
        async with connect(f"ws://127.0.0.1:{port}/", ping_interval=None) as talk.client:
            await talk.begin()
            yield talk
    finally:
        listening.close()
        history.close()


@pytest.fixture
async def talk(tmp_path: Path) -> AsyncIterator[Talk]:
    async with asyncio.timeout(PATIENCE), attached(tmp_path) as talk:
        yield talk


async def test_who_can_not_be_heard_to_answer_is_not_cut_off(talk: Talk) -> None:
    await talk.rest()
    for _ in range(3):
        talk.ping()
        talk.time_out()
        assert not talk.transport.transport.is_closing()
    await talk.go_on()
    talk.ping()
    await talk.answered()


async def test_an_answer_that_is_not_read_yet_when_its_time_runs_out_counts(talk: Talk) -> None:
    """The session has rested, and the socket is read from the loop's next turn on."""
    await talk.rest()
    talk.ping()
    talk.machine.now += 10
    while talk.transport.read_paused:
        await asyncio.sleep(0)
    talk.time_out()
    assert not talk.transport.transport.is_closing()
    await talk.go_on()
    talk.ping()
    await talk.answered()


async def test_who_does_not_answer_though_it_is_read_is_cut_off(talk: Talk) -> None:
    await talk.rest()
    await talk.go_on()
    while talk.transport.read_paused:  # it is looked at again within half a second
        await asyncio.sleep(0)
    talk.ping()
    talk.time_out()
    async with asyncio.timeout(PATIENCE):
        await talk.client.wait_closed()
    assert talk.client.close_code in {1006, 1011}


async def test_pings_of_a_monitor_are_answered_once_the_session_has_rested(talk: Talk) -> None:
    await talk.rest()
    answered = await talk.client.ping()
    await talk.go_on()
    await answered


async def test_pings_of_a_monitor_that_sends_nothing_are_answered_while_it_rests(talk: Talk) -> None:
    talk.machine.dear = 0.003
    talk._other.run(lambda: None)
    await talk.asks(1)
    await talk.hears("decision")
    talk.machine.dear = 0.0
    await (await talk.client.ping())
    talk.ping()
    await talk.answered()
    assert talk.sessions.open["s"].share.rest > 0


async def test_what_waits_while_a_session_rests_is_bounded(talk: Talk) -> None:
    """It is looked at again and again, for there may be a ping."""
    await talk.rest()
    for _ in range(3 * MOST):
        await talk.client.send('{"type":"clock","stamps":[]}')
    for _ in range(500):
        talk.look()
        await asyncio.sleep(0)
    assert MOST <= talk.transport.queue.qsize() < 2 * MOST
    await talk.go_on()
