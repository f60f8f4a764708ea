"""Limits on the bodies of requests: their size, and the time that they take to arrive."""

from __future__ import annotations

import asyncio

from fastapi import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_BODY = 2**20
"""The most bytes that a request's body may have."""
BODY_WITHIN = 30.0
"""Seconds within which all of it must arrive."""


class Bodies:
    """ASGI middleware that answers 413 to a body that is too large, and 408 to one that takes too long."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, and count its body as it is read."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        size, over = 0, False
        deadline = asyncio.get_running_loop().time() + BODY_WITHIN

        async def counted() -> Message:
            nonlocal size, over
            if over:  # after the body comes only the disconnect, which has no time limit
                return await receive()
            try:
                async with asyncio.timeout_at(deadline):
                    message = await receive()
            except TimeoutError:
                raise HTTPException(408, f"the body did not arrive within {BODY_WITHIN:.0f} s") from None
            size += len(message.get("body", b""))
            over = not message.get("more_body", False)
            if size > MAX_BODY:
                raise HTTPException(413, f"a body has at most {MAX_BODY} bytes")
            return message

        await self._app(scope, counted, send)
