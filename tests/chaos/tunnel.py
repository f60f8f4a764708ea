"""A way to the server that can go dead without a word: to either end the connection still seems to stand."""

from __future__ import annotations

import asyncio
from typing import Self
from urllib.parse import urlsplit

from tests.chaos.served import Served


class Tunnel:
    """Passes bytes on between monitors and a server; what a `Link` needs of a server, for one that goes through it."""

    def __init__(self, served: Served) -> None:
        self.served, self.up = served, served.up
        self.dead = 0
        self._ways: set[asyncio.Task[None]] = set()
        self._writers: list[asyncio.StreamWriter] = []
        self._server: asyncio.Server

    @property
    def attach_url(self) -> str:
        """Where monitors attach."""
        port = self._server.sockets[0].getsockname()[1]
        return f"ws://127.0.0.1:{port}/api/v1/attach"

    def go_dead(self) -> None:
        """Pass nothing on any more between those that are connected, and let them think that they are."""
        for way in self._ways:
            self.dead += way.cancel()

    async def __aenter__(self) -> Self:
        """Begin to listen."""
        self._server = await asyncio.start_server(self._connect, "127.0.0.1", 0)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close all that was kept open."""
        self._server.close()
        self.go_dead()
        for writer in self._writers:
            writer.transport.abort()

    async def _connect(self, near: asyncio.StreamReader, to_near: asyncio.StreamWriter) -> None:
        far, to_far = await asyncio.open_connection("127.0.0.1", urlsplit(self.served.url).port)
        self._writers += [to_near, to_far]
        for source, target in ((near, to_far), (far, to_near)):
            way = asyncio.create_task(_pass_on(source, target))
            self._ways.add(way)
            way.add_done_callback(self._ways.discard)


async def _pass_on(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    try:
        while data := await source.read(65536):
            target.write(data)
            await target.drain()
        target.close()
    except ConnectionError:
        target.close()
