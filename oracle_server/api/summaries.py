"""A session's state as Server-Sent Events, for pages: what has changed, a few times a second at most."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator

from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from oracle_server.history.records import Document
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.summary import changed, summary, told
from oracle_server.wire.json import encode

_EVERY = 0.5
"""Seconds between two looks at a session."""
_RATE = 16_000
"""Bytes a second that a client is sent on average."""
_KEEPALIVE = 15.0


async def summaries(registry: Registry, session_id: str) -> AsyncIterator[bytes]:
    """The state of a session, then what has changed of it, until it is closed or the server stops."""
    sent: Document = {}
    spoken = 0.0
    while True:
        commits = registry.commits(session_id)
        found = await registry.state(session_id)
        state = summary(told(found) if found else {"streams": [], "status": "closed"})
        text = b""
        if news := changed(sent, state):
            text = format_sse_event(event="summary", data_str=encode(news))
        elif time.monotonic() - spoken > _KEEPALIVE:
            text = KEEPALIVE_COMMENT
        if text:
            sent, spoken = state, time.monotonic()
            yield text
        if commits is None and not await registry.others.has(session_id):
            yield format_sse_event(event="closed", data_str="{}")
            return
        if commits is not None and commits.ended and registry.commits(session_id) is commits:
            return  # the server stops
        await asyncio.sleep(max(_EVERY, len(text) / _RATE))
