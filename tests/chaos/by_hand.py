"""A monitor whose every frame is sent by the test, and which does not come back by itself."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from websockets.asyncio.client import ClientConnection, connect

from tests.chaos.link import Frame
from tests.chaos.served import Served


@asynccontextmanager
async def attached(
    served: Served, spec: str, session: str, monitor: str, streams: list[str] | None = None
) -> AsyncIterator[ClientConnection]:
    """A connection on which `attached` was read; at the end it is lost. Told to attach again later, it does."""
    wanted = {"type": "attach", "monitor": monitor, "instance": monitor, "session": session, "spec": spec}
    while True:
        async with connect(
            served.attach_url, compression=None, proxy=None, ping_interval=None, open_timeout=None
        ) as socket:
            await socket.send(json.dumps(wanted | {"streams": streams}))
            answer = json.loads(await socket.recv())
            if answer.get("code") == "history_unavailable":
                continue
            assert answer["type"] == "attached", answer
            try:
                yield socket
            finally:
                socket.transport.abort()
            return


async def say(socket: ClientConnection, frames: list[Frame], at_once: int = 1) -> None:
    """Send frames, or batches of so many events."""
    for start in range(0, len(frames), at_once):
        batch = frames[start : start + at_once]
        await socket.send(json.dumps(batch[0] if at_once == 1 else {"type": "events", "events": batch}))


async def until_acked(socket: ClientConnection, upto: int) -> None:
    acked = 0
    while acked < upto:
        frame = json.loads(await socket.recv())
        assert frame["type"] != "error", frame
        acked = frame.get("upto", acked)


def event(seq: int, data: Frame) -> Frame:
    return {"type": "event", "seq": seq, "stream": "/t", "stamp": seq, "data": data}
