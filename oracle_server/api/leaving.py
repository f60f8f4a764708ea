"""Work for a client ends when it leaves: an answer that nobody reads would keep others waiting."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from fastapi import HTTPException, Request
from starlette.requests import ClientDisconnect

T = TypeVar("T")

_CHECK_EVERY = 0.25
"""Seconds between two checks whether the client is still connected."""


async def unless_left(request: Request, work: Coroutine[Any, Any, T]) -> T:
    """What comes of work for a request; it is cancelled where the client disconnects before. Raises 400 then."""
    task = asyncio.create_task(work)
    task.add_done_callback(_retrieved)
    try:
        while not (await asyncio.wait((task,), timeout=_CHECK_EVERY))[0]:
            if await request.is_disconnected():
                raise HTTPException(400, "the client disconnected before the answer")
        return task.result()
    finally:
        task.cancel()


async def text_of(request: Request) -> str:
    """The body of a request as text. Raises 422 where it is none, and 400 where it does not come to its end."""
    try:
        body = await request.body()
    except ClientDisconnect:
        raise HTTPException(400, "the client disconnected before the end of the body") from None
    try:
        return body.decode()
    except UnicodeDecodeError:
        raise HTTPException(422, "not UTF-8 text") from None


def _retrieved(task: asyncio.Task[Any]) -> None:
    if not task.cancelled():
        task.exception()  # else it is logged where the client has disconnected
