"""What was read from a socket at once is processed in slices, in its order, and other connections between them."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from typing import Any, cast

import pytest
import uvicorn
from uvicorn.server import ServerState
from websockets.frames import Frame, Opcode
from websockets.protocol import OPEN

from oracle_server.edge import slices
from oracle_server.edge.slices import SLICE
from oracle_server.edge.transport import WebSocketTransport
from tests.edge.test_transport import app
from tests.processes import PATIENCE


class Transport:
    """A socket that notes whether it is read."""

    def __init__(self) -> None:
        self.reading, self.closing = True, False
        self.written = b""

    def pause_reading(self) -> None:
        self.reading = False

    def resume_reading(self) -> None:
        self.reading = True

    def is_closing(self) -> bool:
        return self.closing

    def write(self, data: bytes) -> None:
        self.written += data

    def close(self) -> None:
        self.closing = True


class Receiver:
    """Takes every message, or leaves them to the application."""

    def __init__(self) -> None:
        self.rest = 0.0
        self.takes = True
        self.turns = 0
        self.texts: list[str] = []

    def offer(self, text: str) -> bool:
        if self.takes:
            self.texts.append(text)
        return self.takes

    def take(self, work: Callable[[], None]) -> None:
        self.turns += 1
        work()


class Noted(WebSocketTransport):
    """Notes the sizes of what it processes."""

    slices: list[int]

    def process(self, data: bytes) -> None:
        self.slices.append(len(data))
        super().process(data)


class Open:
    """A WebSocket that is open."""

    def __init__(self) -> None:
        config = uvicorn.Config(app, ws="none")
        config.load()
        self.transport, self.receiver = Transport(), Receiver()
        self.socket = Noted(config, ServerState(), {}, asyncio.get_running_loop())
        self.socket.slices = []
        self.socket.transport = cast("Any", self.transport)
        self.socket.connections.add(self.socket)
        self.socket.receiver, self.socket.handshake_complete = self.receiver, True
        self.socket.conn.state = OPEN
        parser = self.socket.conn.parse()
        next(parser)
        self.socket.conn.parser = parser

    def says(self, *texts: str) -> None:
        """All that a socket was asked to hand over at once."""
        self.socket.data_received(b"".join(frame(Opcode.TEXT, text.encode()) for text in texts))


def frame(opcode: Opcode, data: bytes, *, fin: bool = True) -> bytes:
    return Frame(opcode, data, fin=fin).serialize(mask=True)


@pytest.fixture
async def opened(monkeypatch: pytest.MonkeyPatch) -> Open:
    monkeypatch.setattr(slices, "_TURN", -1.0)  # each slice is a turn
    return Open()


async def until(found: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not found():
            await asyncio.sleep(0)


SMALL = [str(i) for i in range(5_000)]


async def test_forty_thousand_bytes_are_not_processed_at_once(opened: Open) -> None:
    opened.says(*SMALL)
    assert opened.socket.slices == [SLICE]
    assert not opened.transport.reading
    await until(lambda: opened.transport.reading)
    assert max(opened.socket.slices) == SLICE
    assert opened.receiver.texts == SMALL


async def test_what_came_first_is_taken_first_whoever_takes_it(opened: Open) -> None:
    opened.receiver.takes = False
    opened.says(*SMALL)
    await asyncio.sleep(0)
    assert opened.socket.slices == [SLICE], "while messages wait nothing more is processed"
    got: list[str] = []
    while len(got) < len(SMALL):
        message = cast("dict[str, str]", await opened.socket.receive())
        got.append(message["text"])
        assert not opened.receiver.texts
    assert got == SMALL
    await until(lambda: opened.transport.reading)


async def test_what_waits_is_had_without_waiting_and_what_was_read_behind_it_comes_next(opened: Open) -> None:
    opened.receiver.takes = False
    opened.says(*SMALL)
    got = 0
    while (message := opened.socket.receive_waiting()) is not None:
        assert cast("dict[str, str]", message)["text"] == SMALL[got]
        got += 1
    assert 0 < got < len(SMALL)
    opened.receiver.takes = True
    await until(lambda: opened.transport.reading)
    assert opened.receiver.texts == SMALL[got:]


async def test_nothing_more_is_processed_while_the_session_rests_but_a_ping_is_answered(
    opened: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slices, "LOOK", 0.0)
    opened.receiver.rest, opened.receiver.takes = 10.0, False
    long = frame(Opcode.TEXT, b"x" * 10 * SLICE)
    opened.socket.data_received(long + frame(Opcode.PING, b"there?"))
    assert opened.socket.slices == [SLICE]
    assert not opened.transport.reading
    await until(lambda: b"there?" in opened.transport.written)
    assert opened.socket.queue.qsize() == 1, "the message waits"
    opened.receiver.rest = 0.0
    await opened.socket.receive()
    await until(lambda: opened.transport.reading)


async def test_it_is_looked_at_no_sooner_than_the_rest_is_over(opened: Open) -> None:
    opened.receiver.rest = 10_000.0
    opened.says(*SMALL)
    for _ in range(100):
        await asyncio.sleep(0)
    assert opened.socket.slices == [SLICE]


async def test_what_was_read_before_the_connection_was_lost_is_taken(opened: Open) -> None:
    opened.says(*SMALL)
    opened.transport.closing = True
    opened.socket.connection_lost(ConnectionResetError())
    await until(lambda: not opened.socket.queue.empty())
    assert opened.receiver.texts == SMALL
    assert cast("dict[str, str]", await opened.socket.receive())["type"] == "websocket.disconnect"


async def test_a_close_behind_much_else_is_found_once_the_application_has_closed(opened: Open) -> None:
    opened.receiver.takes = False
    data = b"".join(frame(Opcode.TEXT, text.encode()) for text in SMALL)
    opened.socket.data_received(data + frame(Opcode.CLOSE, struct.pack("!H", 1000)))
    await opened.socket.send({"type": "websocket.close", "code": 1000, "reason": ""})
    await until(lambda: opened.transport.closing)


async def test_a_turn_is_charged_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is charged for asks the processor's clock, which takes as long as a slice of a long message."""
    monkeypatch.setattr(slices, "_TURN", 1e9)
    opened = Open()
    opened.says("x" * 50 * SLICE)
    assert (opened.receiver.turns, len(opened.socket.slices)) == (1, 51)
    assert [len(text) for text in opened.receiver.texts] == [50 * SLICE]


async def test_fragments_are_kept_as_one_however_many_and_however_small(opened: Open) -> None:
    opened.socket.data_received(frame(Opcode.TEXT, b"[", fin=False))
    for piece in (b"", b"1,", b"", b"2") * 1_000:
        opened.socket.data_received(frame(Opcode.CONT, piece, fin=False))
    await until(lambda: opened.transport.reading)
    assert len(opened.socket.frames) == 1
    opened.socket.data_received(frame(Opcode.CONT, b"]"))
    await until(lambda: opened.transport.reading)
    assert opened.receiver.texts == ["[" + "1,2" * 1_000 + "]"]


async def test_bytes_in_fragments_are_bytes(opened: Open) -> None:
    opened.socket.data_received(frame(Opcode.BINARY, b"a", fin=False) + frame(Opcode.CONT, b"b"))
    message = cast("dict[str, object]", await opened.socket.receive())
    assert message == {"type": "websocket.receive", "bytes": b"ab"}
    assert type(message["bytes"]) is bytes
