"""What a monitor is told first."""

from __future__ import annotations

import asyncio
import json
from typing import Any, cast

from oracle_server.attach.connection import Connection
from oracle_server.wire.errors import WireError


class Socket:
    """One side of a WebSocket on which nothing comes."""

    def __init__(self) -> None:
        self.scope: dict[str, Any] = {}
        self.sent: list[dict[str, Any]] = []

    async def accept(self, subprotocol: str | None) -> None:
        pass

    async def receive(self) -> dict[str, Any]:
        return await asyncio.Future[dict[str, Any]]()

    async def send_text(self, text: str) -> None:
        self.sent.append(json.loads(text))

    async def close(self, code: int, reason: str) -> None:
        pass


async def test_who_is_replaced_before_it_was_greeted_is_told_only_that() -> None:
    """What was said to its place meanwhile, its successor hears."""
    socket, nobody = Socket(), cast("Any", None)
    connection = Connection(cast("Any", socket), nobody)
    connection.send({"type": "ack", "upto": 3})
    connection.drop(WireError("replaced", "a newer connection of this process took over", fatal=True))
    await connection.serve()
    assert [(frame["type"], frame.get("code")) for frame in socket.sent] == [("error", "replaced")]
