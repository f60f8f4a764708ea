"""Server-Sent Events of an open session: what is told anew after commits, until it is closed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable

from fastapi import HTTPException
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from oracle_server.sessions.registry import Registry

_KEEPALIVE = 15.0
"""Seconds without an event after which a comment is sent, so that both sides notice a lost connection."""
STREAMED = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
"""The headers of streams: a proxy as nginx would else keep events until it has some kilobytes of them."""
_LOOK_AGAIN = 0.5
"""Seconds between two looks at a session that another server has."""


async def followed(
    registry: Registry, session_id: str, page: Callable[[], Awaitable[tuple[bytes, bool]]], every: float
) -> AsyncIterator[bytes]:
    """The events that `page` tells, as text and whether there are more, at once and so many seconds after commits.

    Of a session that another server has they are looked for twice a second.

    The event `closed` is the last one where the session is closed. Where the server stops there is none: the client
    reconnects to the next one, which continues the session. Nor is there one of a session that could not be restored,
    where nothing goes on, until a server restores it.
    """
    quiet = 0.0
    while True:
        commits = registry.commits(session_id)
        upcoming = commits.next() if commits else None
        elsewhere = commits is None and await registry.others.has(session_id)
        text, more = await page()
        if text:
            quiet = 0.0
            yield text
        if more:
            continue
        if elsewhere:
            await asyncio.sleep(_LOOK_AGAIN)
            quiet += _LOOK_AGAIN
            if quiet >= _KEEPALIVE:
                quiet = 0.0
                yield KEEPALIVE_COMMENT
            continue
        if session_id in registry.unrestored:
            return
        if upcoming is None:
            yield format_sse_event(event="closed", data_str="{}")
            return
        if commits and commits.ended and registry.commits(session_id) is commits:
            return
        while not (await asyncio.wait((upcoming,), timeout=_KEEPALIVE))[0]:
            yield KEEPALIVE_COMMENT
        await asyncio.sleep(every)


def number_of(last_event_id: str) -> int:
    """The number that a Last-Event-ID is. Raises 422."""
    if not last_event_id.isascii() or not last_event_id.isdecimal() or len(last_event_id) > 18:
        raise HTTPException(422, "Last-Event-ID: not the id of an event of this stream")
    return int(last_event_id)
