"""A session's verdicts as Server-Sent Events: from the history, page by page, and then as they are committed.

A reader takes what it wants from the history, so that a slow one keeps nothing waiting; HttpTransport ends those that
have stopped to read. FastAPI frames the events, and does not run the stream: it would keep the event loop
busy with each record, where a thread makes the text of a whole page.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, Depends, Header, HTTPException, Query, Request
from fastapi.responses import StreamingResponse
from fastapi.sse import KEEPALIVE_COMMENT, EventSourceResponse, format_sse_event

from oracle_server.api.known import demand_session
from oracle_server.api.questions import Number, Outcomes, chosen
from oracle_server.core.records import VerdictRecord
from oracle_server.edge.scopes import needs
from oracle_server.history.pages import find, latest
from oracle_server.history.port import Reading
from oracle_server.history.query import Query as Question
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.registry import Registry
from oracle_server.wire.json import encode

_PAGE = 100
"""Records that are read at once: what stays in memory for a reader that has stopped, and keeps Python busy."""
_KEEPALIVE = 15.0
"""Seconds of silence after which a comment is sent, so that both sides see whether the other is there."""
_GATHER = 0.05
"""Seconds between two looks at the history, so that a busy session's readers cost little."""


def router(registry: Registry, history: Reading) -> APIRouter:
    """The route of the stream."""
    made = APIRouter(prefix="/api/v1", tags=["verdicts"])

    @made.get(
        "/sessions/{session_id}/stream",
        response_class=StreamingResponse,
        responses={200: {"content": {"text/event-stream": {}}, "description": "Verdict records; the id is their n"}},
    )
    @needs("read")
    async def stream_verdicts(
        request: Request,
        session_id: str,
        question: Annotated[Question, Depends(chosen)],
        outcome: Outcomes,
        violations: Annotated[bool, Query(description="Violations only")] = False,
        after: Number = 0,
        last_event_id: Annotated[str | None, Header(description="The id of the last event that was read")] = None,
    ) -> EventSourceResponse:
        """The verdicts behind `after`, or behind Last-Event-ID, and all that come; `closed` tells that none will."""
        known = await demand_session(request, registry, session_id)
        begin = after if last_event_id is None else _number(last_event_id)
        wanted = replace(question, outcomes=frozenset(outcome), after=begin, limit=_PAGE, violations=violations)
        events = _events(registry, history, session_id, known, wanted)
        return EventSourceResponse(events, headers={"Cache-Control": "no-history"})

    return made


async def _events(
    registry: Registry, history: Reading, session_id: str, known: SessionRecord, wanted: Question
) -> AsyncIterator[bytes]:
    yield format_sse_event(comment="the verdicts of a session")
    while True:
        live = registry.open.get(session_id)
        upcoming = live.ledger.commits.next() if live else None
        text, seen, more = await _page(history, known, wanted)
        if text:
            yield text
        wanted = replace(wanted, after=max(seen, wanted.after or 0))
        if more:
            continue
        if upcoming is None:
            yield format_sse_event(event="closed", data_str="{}")
            return
        if live and live.ledger.commits.ended and registry.open.get(session_id) is live:
            return  # the server stops, and the session goes on with the next one
        while not (await asyncio.wait((upcoming,), timeout=_KEEPALIVE))[0]:
            yield KEEPALIVE_COMMENT
        await asyncio.sleep(_GATHER)


async def _page(history: Reading, known: SessionRecord, wanted: Question) -> tuple[bytes, int, bool]:
    """Events for what comes next in the history, the `n` up to which that is all, and whether there is more."""
    seen = await latest(history, known)
    items, more = await find(history, known, wanted)
    if more is not None:
        seen = more
    elif items:
        seen = max(seen, items[-1]["n"])
    return await asyncio.to_thread(_text, items), seen, more is not None


def _text(records: list[VerdictRecord]) -> bytes:
    return b"".join(format_sse_event(data_str=encode(record), id=str(record["n"])) for record in records)


def _number(last_event_id: str) -> int:
    if not last_event_id.isascii() or not last_event_id.isdecimal() or len(last_event_id) > 18:
        raise HTTPException(422, "Last-Event-ID: not the id of an event of this stream")
    return int(last_event_id)
