"""Bodies of requests that do not come."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import pytest
from fastapi import HTTPException
from starlette.types import Message, Receive, Scope, Send

from oracle_server.edge import bodies
from oracle_server.edge.bodies import Bodies
from tests.processes import PATIENCE


async def test_a_body_that_does_not_come_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bodies, "BODY_WITHIN", 0.01)

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        assert await receive()
        await receive()

    pieces = iter([{"type": "http.request", "body": b"x", "more_body": True}])

    async def receive() -> Message:
        with suppress(StopIteration):
            return next(pieces)
        return await asyncio.Future()

    async def send(_: Message) -> None:
        raise AssertionError

    async with asyncio.timeout(PATIENCE):
        with pytest.raises(HTTPException, match="408"):
            await Bodies(app)({"type": "http", "path": "/"}, receive, send)
