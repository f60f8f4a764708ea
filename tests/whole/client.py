"""A monitor on the other end of a real socket."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import json
import socket
import struct
from collections.abc import AsyncIterator
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from tests.whole.harness import PATIENCE, Server

Frame = dict[str, Any]

_ATTACH_FILTER = 26
"""Linux's `SO_ATTACH_FILTER`: which packets a socket takes, as a program of the Berkeley Packet Filter."""
_BPF_RETURN = 6

BASE = 1_732_147_200 * 10**9
"""A time in the past, in nanoseconds, from which the tests count their stamps."""


class Monitor:
    """One connection of a monitor."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.attached: Frame = {}
        self.upto = 0
        """Up to where the server has acked."""
        self.violations: list[Frame] = []

    async def send(self, *frames: Frame) -> None:
        for frame in frames:
            await self.socket.send(json.dumps(frame))

    async def send_text(self, text: str | bytes) -> None:
        await self.socket.send(text)

    async def recv(self) -> Frame:
        """The next frame, whatever it is."""
        async with asyncio.timeout(PATIENCE):
            frame: Frame = json.loads(await self.socket.recv())
        if frame["type"] == "ack":
            assert frame["upto"] >= self.upto, "acks never go back"
            self.upto = frame["upto"]
        if frame["type"] == "violation":
            self.violations.append(frame)
        return frame

    async def expect(self, type_: str, **fields: Any) -> Frame:
        """The next frame of a type; acks, violations and credit may come before it, and nothing else."""
        while True:
            frame = await self.recv()
            if frame["type"] == type_:
                assert {k: frame.get(k) for k in fields} == fields, frame
                return frame
            assert frame["type"] in ("ack", "violation", "credit"), f"expected {type_}, got {frame}"

    async def acked(self, upto: int) -> None:
        """Wait until all up to a number is acked; other frames are passed over."""
        while self.upto < upto:
            await self.recv()

    async def violated(self, count: int) -> list[Frame]:
        """Wait until so many violations were told; other frames are passed over."""
        while len(self.violations) < count:
            await self.recv()
        return self.violations

    async def ask(self, seq: int, **event: Any) -> Frame:
        """Ask about an event, and wait for the decision."""
        await self.send(make_event(seq, ask=True, **event))
        return await self.expect("decision", seq=seq)

    async def detach(self) -> None:
        await self.send({"type": "detach"})
        await self.expect("detached")

    async def closed(self) -> tuple[list[Frame], int | None]:
        """What comes until the server closes the connection, and the code that it closes with."""
        frames = []
        try:
            while True:
                frames.append(await self.recv())
        except ConnectionClosed as end:
            return frames, end.rcvd.code if end.rcvd else None

    def lose_network(self) -> None:
        """Have nothing that the server sends arrive any more, as where a cable was cut: the system acks nothing."""
        drop_all = ctypes.create_string_buffer(struct.pack("HBBI", _BPF_RETURN, 0, 0, 0))
        program = struct.pack("HL", 1, ctypes.addressof(drop_all))
        self.socket.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, program)

    def vanish(self) -> None:
        """Break the connection without a word."""
        self.socket.transport.abort()


@contextlib.asynccontextmanager
async def connected(server: Server) -> AsyncIterator[Monitor]:
    """A connection on which nothing was said yet."""
    url = server.url.replace("http", "ws", 1) + "/api/v1/attach"
    subprotocols = [Subprotocol("oracle.v1")]
    async with connect(url, subprotocols=subprotocols, proxy=None, open_timeout=PATIENCE, close_timeout=5) as socket:
        yield Monitor(socket)


@contextlib.asynccontextmanager
async def attached(server: Server, monitor: str = "m1", **fields: Any) -> AsyncIterator[Monitor]:
    """A monitor that has attached."""
    async with connected(server) as connection:
        await connection.send(make_attach(monitor, **fields))
        connection.attached = await connection.expect("attached", monitor=monitor)
        yield connection


def make_attach(monitor: str = "m1", **fields: Any) -> Frame:
    frame: Frame = {"type": "attach", "monitor": monitor, "instance": f"{monitor}-1", **fields}
    return {key: value for key, value in frame.items() if value is not None}


def make_event(seq: int, stream: str = "/a", at: float = 0, data: object = None, **fields: Any) -> Frame:
    """An event stamped `at` milliseconds after `BASE`."""
    event: Frame = {"type": "event", "seq": seq, "stream": stream, "kind": "topic", "stamp": BASE + round(at * 10**6)}
    return event | {"data": {} if data is None else data} | fields


def make_events(*events: Frame) -> Frame:
    return {"type": "events", "events": list(events)}


def make_clock(stream: str, at: float, kind: str = "topic") -> Frame:
    """A clock `at` milliseconds after `BASE`."""
    return {"type": "clock", "stamps": [{"stream": stream, "kind": kind, "stamp": BASE + round(at * 10**6)}]}


def stable(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Records without what depends on when they were made, and on when their events came."""
    varying = ("arrived", "judged", "released", "waited")
    return [{k: v for k, v in record.items() if k not in varying} for record in records]


def seqs(server: Server, session: str) -> list[int]:
    return list(dict.fromkeys(r["seq"] for r in server.records(session)))


async def good(monitor: Monitor, seq: int) -> None:
    """An event is taken as if nothing had happened."""
    await monitor.send(make_event(seq, at=seq, data={"v": 1}))
    await monitor.acked(seq)


def monitors(server: Server, session: str) -> dict[str, Any]:
    return {m["name"]: m for m in server.get(f"sessions/{session}")["monitors"]}


def judged(server: Server, session: str) -> list[tuple[str, str, int]]:
    """What was judged, in order: monitor, stream and number of each event."""
    found = [(r["monitor"], r["stream"], r["seq"]) for r in server.records(session)]
    return list(dict.fromkeys(found))
