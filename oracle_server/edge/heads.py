"""HEAD, as whoever looks whether the server is there asks: what GET answers, without the body."""

from __future__ import annotations

import asyncio

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class Heads:
    """ASGI middleware that answers HEAD by the head of GET. A stream, which may have no end, is cut off behind it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, as GET where it is HEAD; the server leaves the body out."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        cut = asyncio.timeout(None)

        async def send_head(message: Message) -> None:
            if not message.get("more_body", False):
                await send(message)
                return
            await send({"type": "http.response.body"})
            cut.reschedule(asyncio.get_running_loop().time())
            await asyncio.Event().wait()

        try:
            async with cut:
                await self._app({**scope, "method": "GET"}, receive, send_head)
        except TimeoutError:
            if not cut.expired():
                raise
