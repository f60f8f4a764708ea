"""Oracles on the other end, in a process of their own: `python -m tests.remote.playing` prints the port.

By the path: one that answers as RML's Prolog does, one that answers as TLOracle does and takes its time, and one that
does what a test says frame by frame: `/play/NAME` for a second connection at `/control/NAME`.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import sys
from collections import defaultdict
from typing import Any
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed


async def prolog(socket: ServerConnection) -> None:
    """`v` is never more than 5: `currently_true` as a string, and once it is violated a boolean, for good."""
    sound = True
    async for text in socket:
        sound = sound and json.loads(text)["v"] <= 5
        await socket.send('{"verdict": "currently_true"}' if sound else '{"verdict": false}')


async def temporal(socket: ServerConnection, seconds: float) -> None:
    """`v` was more than 5 once; the reply is the event with a verdict, after a while."""
    once = False
    async for text in socket:
        event = json.loads(text)
        once = once or event["v"] > 5
        await asyncio.sleep(seconds)
        await socket.send(json.dumps(event | {"verdict": "currently_true" if once else "currently_false"}))


class Stage:
    """One test's oracle. Tells the test of each connection and frame, and does with a connection what it says."""

    def __init__(self) -> None:
        self._control: ServerConnection | None = None
        self._told: list[dict[str, Any]] = []
        self._sockets: dict[int, ServerConnection] = {}
        self._numbers = itertools.count(1)

    async def control(self, socket: ServerConnection) -> None:
        """Serve the test: `{"to": connection, "say": text or null}`, where null breaks the connection."""
        self._control = socket
        for told in self._told:
            await socket.send(json.dumps(told))
        async for text in socket:
            order = json.loads(text)
            target = self._sockets[order["to"]]
            with contextlib.suppress(ConnectionClosed):
                if order["say"] is None:
                    target.transport.abort()
                else:
                    await target.send(order["say"])
            await self._tell({"did": order["to"]})

    async def play(self, socket: ServerConnection) -> None:
        """Serve the oracle's client."""
        number = next(self._numbers)
        self._sockets[number] = socket
        await self._tell({"opened": number})
        with contextlib.suppress(ConnectionClosed):
            async for text in socket:
                await self._tell({"from": number, "event": json.loads(text)})
        await self._tell({"closed": number})

    async def _tell(self, what: dict[str, Any]) -> None:
        if self._control is None:
            self._told.append(what)
        else:
            await self._control.send(json.dumps(what))


async def main() -> None:
    stages: defaultdict[str, Stage] = defaultdict(Stage)

    async def handle(socket: ServerConnection) -> None:
        assert socket.request is not None
        url = urlsplit(socket.request.path)
        match url.path.split("/")[1:]:
            case ["prolog"]:
                await prolog(socket)
            case ["slow"]:
                await temporal(socket, float(parse_qs(url.query)["seconds"][0]))
            case ["control", name]:
                await stages[name].control(socket)
            case ["play", name]:
                await stages[name].play(socket)

    async with serve(handle, "127.0.0.1", int(sys.argv[1]) if sys.argv[1:] else 0, ping_interval=None) as server:
        print(server.sockets[0].getsockname()[1], flush=True)
        await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(main())
