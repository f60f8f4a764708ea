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
_NO_FORM = "a form is not read: send the file itself as the body, as `curl --data-binary @FILE` does"
_NOT_PACKED = "a compressed body is not read: send it as it is, without `Content-Encoding`"


def _is_form(scope: Scope) -> bool:
    """Whether a body is what pages send of several fields: read as the file that is in it, it is judged as garbage."""
    return any(
        name == b"content-type" and value.lower().startswith(b"multipart/") for name, value in scope.get("headers", ())
    )


def _is_packed(scope: Scope) -> bool:
    """Whether a body is compressed: read as it comes, it would be no text, or a recording that is damaged."""
    codings = (value.strip().lower() for name, value in scope.get("headers", ()) if name == b"content-encoding")
    return any(coding not in (b"", b"identity") for coding in codings)


class Bodies:
    """ASGI middleware that refuses bodies: 413 where too large, 408 where too slow, 415 for a form, or compressed."""

    def __init__(self, app: ASGIApp, larger: Mapping[str, int] | None = None) -> None:
        """`larger`: the most bytes that the bodies of some paths may have instead."""
        self._app, self._larger = app, larger or {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, and count its body as it is read."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        most = self._larger.get(scope["path"], MAX_BODY)
        size, over, answered = 0, False, asyncio.Event()
        deadline = asyncio.get_running_loop().time() + BODY_WITHIN
        unread = _NO_FORM if _is_form(scope) else _NOT_PACKED if _is_packed(scope) else None

        async def counted() -> Message:
            nonlocal size, over, deadline
            if unread is not None and not answered.is_set():
                raise HTTPException(415, unread)
            if over or answered.is_set():  # all that matters by then is the disconnect, which has no time limit
                return await receive()
            try:
                async with asyncio.timeout_at(deadline):
                    message = await receive()
            except TimeoutError:
                if answered.is_set():
                    return await receive()
                raise HTTPException(408, f"the body did not arrive within {BODY_WITHIN:.0f} s") from None
            size += len(message.get("body", b""))
            over = not message.get("more_body", False)
            if size > most and not answered.is_set():
                raise HTTPException(413, f"a body has at most {most} bytes")
            if size > MAX_BODY:
                deadline += len(message.get("body", b"")) / _SLOWEST
            return message

        async def answering(message: Message) -> None:
            answered.set()
            await send(message)

        await self._app(scope, counted, answering)
