"""A session's state as Server-Sent Events, for pages: what has changed, a few times a second at most."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from functools import partial

from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from oracle_server.history.port import Reading
from oracle_server.history.records import Document
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.summary import changed, summary, told
from oracle_server.wire.json import encode

_EVERY = 0.5
"""Seconds between two looks at a session."""
_RATE = 16_000
"""Bytes a second that a client is sent on average."""
_KEEPALIVE = 15.0


async def summaries(registry: Registry, history: Reading, session_id: str) -> AsyncIterator[bytes]:
    """The state of a session, then what has changed of it, until it is closed or the server stops.

    What has changed is found in a thread that reads for the client: a session may have thousands of monitors.
    """
    sent: Document = {}
    spoken = 0.0
    while True:
        commits = registry.commits(session_id)
        found = await registry.state(session_id)
        state, text = await history.in_thread(partial(_news, sent, found))
        if not text and time.monotonic() - spoken > _KEEPALIVE:
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


def _news(sent: Document, found: Document | None) -> tuple[Document, bytes]:
    """The summary of a state that was found, and the event that tells what differs from what was sent, if any."""
    state = summary(told(found) if found else {"streams": [], "status": "closed"})
    news = changed(sent, state)
    return state, format_sse_event(event="summary", data_str=encode(news)) if news else b""
