"""Limits on the bodies of requests: their size, and the time that they take to arrive."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from fastapi import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_BODY = 2**20
"""The most bytes that a request's body may have, where its path has no other limit."""
BODY_WITHIN = 30.0
"""Seconds within which all of it must arrive."""
_SLOWEST = 2**16
"""Bytes a second that a larger one must arrive with, on average."""


class Bodies:
    """ASGI middleware that answers 413 to a body that is too large, and 408 to one that takes too long."""

    def __init__(self, app: ASGIApp, larger: Mapping[str, int] | None = None) -> None:
        """`larger`: the most bytes that the bodies of some paths may have instead."""
        self._app, self._larger = app, larger or {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, and count its body as it is read."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        most = self._larger.get(scope["path"], MAX_BODY)
        size, over = 0, False
        deadline = asyncio.get_running_loop().time() + BODY_WITHIN

        async def counted() -> Message:
            nonlocal size, over, deadline
            if over:  # after the body comes only the disconnect, which has no time limit
                return await receive()
            try:
                async with asyncio.timeout_at(deadline):
                    message = await receive()
            except TimeoutError:
                raise HTTPException(408, f"the body did not arrive within {BODY_WITHIN:.0f} s") from None
            size += len(message.get("body", b""))
            over = not message.get("more_body", False)
            if size > most:
                raise HTTPException(413, f"a body has at most {most} bytes")
            if size > MAX_BODY:
                deadline += len(message.get("body", b"")) / _SLOWEST
            return message

        await self._app(scope, counted, send)
