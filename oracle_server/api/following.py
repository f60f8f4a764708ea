"""Server-Sent Events of an open session: what is told anew after commits, until it is closed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable

from fastapi import HTTPException
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from oracle_server.sessions.registry import Registry

_KEEPALIVE = 15.0
"""Seconds without an event after which a comment is sent, so that both sides notice a lost connection."""


async def followed(
    registry: Registry, session_id: str, page: Callable[[], Awaitable[tuple[bytes, bool]]], every: float
) -> AsyncIterator[bytes]:
    """The events that `page` tells, as text and whether there are more, at once and so many seconds after commits.

    The event `closed` is the last one where the session is closed. Where the server stops there is none: the client
    reconnects to the next one, which continues the session.
    """
    while True:
        live = registry.open.get(session_id)
        upcoming = live.ledger.commits.next() if live else None
        text, more = await page()
        if text:
            yield text
        if more:
            continue
        if upcoming is None:
            yield format_sse_event(event="closed", data_str="{}")
            return
        if live and live.ledger.commits.ended and registry.open.get(session_id) is live:
            return
        while not (await asyncio.wait((upcoming,), timeout=_KEEPALIVE))[0]:
            yield KEEPALIVE_COMMENT
        await asyncio.sleep(every)


def number_of(last_event_id: str) -> int:
    """The number that a Last-Event-ID is. Raises 422."""
    if not last_event_id.isascii() or not last_event_id.isdecimal() or len(last_event_id) > 18:
        raise HTTPException(422, "Last-Event-ID: not the id of an event of this stream")
    return int(last_event_id)
