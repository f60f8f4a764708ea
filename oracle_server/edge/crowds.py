"""Requests that come at the same time, begun one after the other: decisions wait for one of them, not for hundreds."""

from __future__ import annotations

import asyncio
from collections import deque

from starlette.types import ASGIApp, Receive, Scope, Send


class Crowds:
    """ASGI middleware that begins one request or WebSocket at each turn of the event loop, in the order they came.

    Else a client that sends hundreds at once has all of them begin in one turn, for which everybody waits.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._begun = False
        """Whether one has begun at this turn."""
        self._waiting: deque[asyncio.Future[None]] = deque()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on once it is its turn."""
        loop = asyncio.get_running_loop()
        if self._begun:
            turn = loop.create_future()
            self._waiting.append(turn)
            await turn
        else:
            self._begun = True
            loop.call_soon(self._pass_on)
        await self._app(scope, receive, send)

    def _pass_on(self) -> None:
        while self._waiting:
            turn = self._waiting.popleft()
            if not turn.done():  # else it was cancelled
                turn.set_result(None)
                asyncio.get_running_loop().call_soon(self._pass_on)
                return
        self._begun = False
