"""A connection whose session rests: it is not read on, and nothing else changes."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, cast

import pytest
from starlette.websockets import WebSocket

from oracle_server.attach import throttle
from oracle_server.attach.connection import Connection
from oracle_server.edge.tokens import Grant
from oracle_server.edge.transport import DIRECT
from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.shares import FREE, Shares
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, registry


class Machine:
    """A clock and a processor; each look at the processor finds that `dear` seconds more were spent."""

    def __init__(self) -> None:
        self.now = self.spent = self.dear = 0.0

    def look(self) -> float:
        self.spent += self.dear
        return self.spent


class Socket:
    """A WebSocket in memory, as far as a connection uses it."""

    def __init__(self) -> None:
        self.scope: dict[str, Any] = {}
        self.state = type("State", (), {"grant": Grant(frozenset({"submit"}))})()
        self.arrived: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.sent: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.closed: list[Any] | None = None
        self.gone = False

    async def accept(self, _protocol: str | None) -> None: ...

    async def receive(self) -> dict[str, Any]:
        return await self.arrived.get()

    async def send_text(self, text: str) -> None:
        if self.gone:
            raise RuntimeError
        self.sent.put_nowait(json.loads(text))

    async def close(self, *why: Any) -> None:
        self.closed = [*why]

    def says(self, frame: dict[str, Any]) -> None:
        self.arrived.put_nowait({"type": "websocket.receive", "text": json.dumps(frame)})

    def leaves(self) -> None:
        self.gone = True
        self.arrived.put_nowait({"type": "websocket.disconnect", "code": 1006})

    async def hears(self, kind: str, number: int = 1) -> list[dict[str, Any]]:
        """So many frames of a type."""
        found: list[dict[str, Any]] = []
        async with asyncio.timeout(PATIENCE):
            while len(found) < number:
                frame = await self.sent.get()
                found += [frame] if frame["type"] == kind else []
        return found

    def heard(self) -> list[str]:
        """The types of all frames that were sent and not heard yet."""
        return [self.sent.get_nowait()["type"] for _ in range(self.sent.qsize())]


class Direct(Socket):
    """One that tells what waits."""

    receiver: object = None

    def receive_waiting(self) -> dict[str, Any] | None:
        return None if self.arrived.empty() else self.arrived.get_nowait()


class Talk:
    """A monitor that is attached, beside a session that is active."""

    def __init__(self, sessions: Registry, machine: Machine, shares: Shares) -> None:
        self.socket, self.sessions, self.machine = Socket(), sessions, machine
        self._other = shares.share()
        self.connection = Connection(cast("WebSocket", self.socket), sessions)
        self.serving = asyncio.create_task(self.connection.serve())

    @property
    def session(self) -> LiveSession:
        return self.sessions.open["s"]

    async def begin(self) -> None:
        wanted = {"type": "attach", "monitor": "m", "instance": "i", "session": "s", "spec": "guard"}
        self.socket.says(wanted)
        await self.socket.hears("attached")

    def asks(self, seq: int) -> dict[str, Any]:
        return {"type": "event", "seq": seq, "stream": "/go", "data": {"speed": seq}, "ask": True}

    async def tire(self) -> None:
        """Let one event take so long that the session rests."""
        self.machine.dear = 0.003
        self._other.run(lambda: None)
        self.socket.says(self.asks(1))
        await self.socket.hears("decision")
        self.machine.dear = 0.0
        assert self.session.share.rest > 0

    async def idle(self) -> None:
        """Let everything run that can."""
        for _ in range(50):
            await asyncio.sleep(0)

    async def ended(self) -> None:
        async with asyncio.timeout(PATIENCE):
            await self.serving


@pytest.fixture
async def talk(tmp_path: Path) -> AsyncIterator[Talk]:
    machine = Machine()
    shares = Shares(lambda: machine.now, machine.look)
    history = MemoryHistory()
    talk = Talk(registry(history, tmp_path, GUARD, shares=shares), machine, shares)
    await talk.begin()
    yield talk
    talk.serving.cancel()
    await asyncio.wait((talk.serving,))
    history.close()


async def test_what_comes_while_it_rests_is_taken_afterwards_in_its_order(talk: Talk) -> None:
    await talk.tire()
    for seq in (2, 3):
        talk.socket.says(talk.asks(seq))
    batch = [talk.asks(seq) for seq in range(4, 200)]
    talk.socket.says({"type": "events", "events": batch})
    await talk.idle()
    assert "decision" not in talk.socket.heard(), "nothing is taken while it rests"
    talk.machine.now += 10
    decisions = await talk.socket.hears("decision", 198)
    assert [(d["seq"], d["decision"]) for d in decisions] == [
        (seq, "allow" if seq <= 3 else "deny") for seq in range(2, 200)
    ]


async def test_what_is_left_of_a_batch_when_it_rests_is_taken_afterwards(talk: Talk) -> None:
    talk.session.share.run(lambda: None)
    await talk.tire()
    talk.machine.now += 10
    talk.machine.dear = FREE / 2
    talk.socket.says({"type": "events", "events": [talk.asks(seq) for seq in range(2, 500)]})
    found: list[dict[str, Any]] = []
    while len(found) < 498:
        talk._other.run(lambda: None)
        found += await talk.socket.hears("decision")
        talk.machine.now += 0.5
    assert [d["seq"] for d in found] == [*range(2, 500)]


async def test_a_session_is_closed_while_it_rests(talk: Talk) -> None:
    await talk.tire()
    talk.socket.says(talk.asks(2))
    assert await talk.sessions.closed_within(talk.session, PATIENCE)
    (error,) = await talk.socket.hears("error")
    assert error["code"] == "session_closed"
    await talk.ended()
    assert talk.socket.closed == [1008, "session_closed"]


async def test_a_connection_is_replaced_while_it_rests(talk: Talk) -> None:
    await talk.tire()
    talk.socket.says(talk.asks(2))
    again = Talk(talk.sessions, talk.machine, talk.sessions.shares)
    await again.begin()
    (error,) = await talk.socket.hears("error")
    assert error["code"] == "replaced"
    await talk.ended()
    talk.machine.now += 10
    again.socket.says(again.asks(2))
    (decision,) = await again.socket.hears("decision")
    assert decision["seq"] == 2
    again.serving.cancel()
    await asyncio.wait((again.serving,))


async def test_the_server_stops_while_it_rests(talk: Talk) -> None:
    await talk.tire()
    talk.socket.says(talk.asks(2))
    await talk.sessions.shut_down()
    (error,) = await talk.socket.hears("error")
    assert error["code"] == "shutting_down"
    await talk.ended()


async def test_what_came_before_the_connection_was_lost_is_taken(talk: Talk) -> None:
    await talk.tire()
    talk.socket.says({"type": "events", "events": [talk.asks(seq) for seq in range(2, 300)]})
    talk.socket.leaves()
    talk.connection.send({"type": "credit", "events": 1})  # by which the writer learns that the connection is lost
    await talk.idle()
    assert not talk.serving.done()
    talk.machine.now += 10
    await talk.ended()
    talk.session.ledger.write()
    await talk.sessions.flush()
    assert talk.session.monitors["m"].numbering.upto == 299


async def test_acks_and_what_others_cause_are_sent_while_it_rests(talk: Talk) -> None:
    await talk.tire()
    (ack,) = await talk.socket.hears("ack")
    assert ack["upto"] == 1


async def test_what_is_processed_on_arrival_waits_too(talk: Talk) -> None:
    await talk.idle()
    taken: list[bool] = []

    def arrive() -> None:  # one event, since a second one waits where the first took long
        taken.append(talk.connection.offer(json.dumps(talk.asks(len(taken) + 1))))

    talk.connection.take(arrive)
    talk.connection.take(arrive)
    assert taken == [True, True]
    talk._other.run(lambda: None)
    talk.machine.dear = 0.003
    talk.connection.take(lambda: None)
    talk.connection.take(arrive)
    assert taken[2:] == [False]


async def test_what_arrives_while_others_have_their_turn_is_taken_on_its_arrival(
    talk: Talk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else one frame that has waited for the reader would lead all later ones through it, for as long as they come."""
    monkeypatch.setattr(throttle, "_AT_ONCE", 1)
    taken: list[bool] = []

    def arrive() -> None:
        taken.append(talk.connection.offer(json.dumps(talk.asks(2))))

    judged = talk.session.ingest

    def ingest(*event: Any) -> Any:
        asyncio.get_running_loop().call_soon(talk.connection.take, arrive)  # before the reader has its next turn
        monkeypatch.setattr(talk.session, "ingest", judged)
        return judged(*event)

    monkeypatch.setattr(talk.session, "ingest", ingest)
    talk.socket.says(talk.asks(1))
    decisions = await talk.socket.hears("decision", 2)
    assert (taken, [d["seq"] for d in decisions]) == ([True], [1, 2])


async def test_frames_that_wait_are_processed_in_one_turn_which_ends(
    talk: Talk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(throttle, "_AT_ONCE", 3)
    monkeypatch.setattr(throttle, "_TURN", PATIENCE)
    socket = Direct()
    socket.scope["extensions"] = {DIRECT: socket}
    serving = asyncio.create_task(Connection(cast("WebSocket", socket), talk.sessions).serve())
    socket.says({"type": "attach", "monitor": "n", "instance": "i", "session": "s", "spec": "guard"})
    await socket.hears("attached")
    turns: list[int] = []
    run = talk.session.share.run

    def charged(*work: Any) -> Any:
        before = talk.session.monitors["n"].unsettled
        run(*work)
        turns.append(talk.session.monitors["n"].unsettled - before)

    monkeypatch.setattr(talk.session.share, "run", charged)
    for seq in range(1, 6):
        socket.says(talk.asks(seq))
    decisions = await socket.hears("decision", 5)
    assert [d["seq"] for d in decisions] == [*range(1, 6)]
    assert [events for events in turns if events > 0] == [3, 2]
    socket.leaves()
    await asyncio.wait((serving,))
