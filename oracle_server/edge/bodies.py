"""The bodies of requests: bounded in size and time, whatever they are for."""

from __future__ import annotations

import asyncio

from fastapi import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_BODY = 2**20
"""Bytes of a request's body."""
BODY_WITHIN = 30.0
"""Seconds in which all of it must have come."""


class Bodies:
    """Answers 413 to a body that is too long, and 408 to one that does not come."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand a request on with its body counted."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        size, over = 0, False
        deadline = asyncio.get_running_loop().time() + BODY_WITHIN

        async def counted() -> Message:
            nonlocal size, over
            if over:  # what comes after the body is the end of the connection, however long that takes
                return await receive()
            try:
                async with asyncio.timeout_at(deadline):
                    message = await receive()
            except TimeoutError:
                raise HTTPException(408, f"the body did not come within {BODY_WITHIN:.0f} s") from None
            size += len(message.get("body", b""))
            over = not message.get("more_body", False)
            if size > MAX_BODY:
                raise HTTPException(413, f"a body has at most {MAX_BODY} bytes")
            return message

        await self._app(scope, counted, send)
