"""A session's verdicts as Server-Sent Events: from the history, page by page, and then as they are committed.

Each stream reads from the history, so that a slow client delays nothing; `HttpTransport` disconnects clients that do
not read at all. FastAPI only sends the events: its own streaming would encode each record on the event loop, where
the history gives a whole page as JSON here.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Annotated

from fastapi import Depends, Header, HTTPException, Query, Request
from fastapi.responses import StreamingResponse
from fastapi.sse import EventSourceResponse, format_sse_event

from oracle_server.api.following import STREAMED, followed, number_of
from oracle_server.api.known import demand_properties, demand_session, demand_stream, doubts_of
from oracle_server.api.questions import Number, Outcomes, chosen
from oracle_server.api.routes import Routes
from oracle_server.api.summaries import summaries
from oracle_server.edge.scopes import needs
from oracle_server.history.pages import find
from oracle_server.history.port import Reading
from oracle_server.history.query import Query as Question
from oracle_server.history.records import SessionRecord
from oracle_server.history.views import Doubts
from oracle_server.sessions.registry import Registry
from oracle_server.wire.json import encode

_PAGE = 100
"""Records that are read at once; so many stay in memory for a client that does not read."""
_GATHER = 0.05
"""Seconds between two reads of the history, so that streams of a busy session cost little."""


def router(registry: Registry, history: Reading) -> Routes:
    """The route of the stream."""
    routes = Routes(prefix="/api/v1", tags=["verdicts"])

    @routes.get(
        "/sessions/{session_id}/stream",
        response_class=StreamingResponse,
        responses={
            200: {
                "content": {"text/event-stream": {}},
                "description": "Verdict records; the id is their n. `missed`: some that are not kept any more, or that "
                "another session of this name had. With `summary`: events of that name",
            }
        },
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
        summary: Annotated[bool, Query(description="The session's state in place of verdicts")] = False,
    ) -> EventSourceResponse:
        """Stream the verdicts after `after` or Last-Event-ID, then new ones; the event `closed` is the last one.

        Where it can't go on behind the last one that was read, the event `missed` says why, and which one comes `next`.

        Revisions are among them, unless what was said at first is asked for. With `summary=true` there are no verdicts,
        but events `summary`: the session's state, then what has changed of it, twice a second at most.
        """
        known = await demand_session(request, registry, session_id)
        if summary:
            if {*request.query_params} - {"summary"}:
                raise HTTPException(422, "summary: stands alone, since it selects no verdicts")
            return EventSourceResponse(summaries(registry, history, session_id), headers=STREAMED)
        demand_properties(known, question.properties)
        await demand_stream(registry, history, known, question.stream)
        begin = after if last_event_id is None else number_of(last_event_id)
        asked = replace(question, outcomes=frozenset(outcome), violations=violations)
        wanted = replace(asked, after=begin, limit=_PAGE, follows=True)
        first, wanted, _ = await _page(history, known, wanted, doubts_of(registry, session_id))
        events = _events(registry, history, session_id, known, wanted, first)
        return EventSourceResponse(events, headers=STREAMED)

    return routes


async def _events(
    registry: Registry, history: Reading, session_id: str, known: SessionRecord, wanted: Question, first: bytes
) -> AsyncIterator[bytes]:
    """The first page, which was read before the response began: what comes from then on is followed without a gap."""
    yield format_sse_event(comment="the verdicts of a session") + first
    asked = wanted

    async def page() -> tuple[bytes, bool]:
        nonlocal asked
        text, asked, more = await _page(history, known, asked, doubts_of(registry, session_id))
        return text, more

    async for text in followed(registry, session_id, page, _GATHER):
        yield text


async def _page(
    history: Reading, known: SessionRecord, wanted: Question, doubts: Doubts | None
) -> tuple[bytes, Question, bool]:
    """The next events as text, what is asked for behind them, and whether there is more of it already."""
    deleted, last = await _ends(history, known)
    while True:
        told, asked = _missed(wanted, deleted, last)
        items, more = await find(history, known, asked, doubts)
        deleted, now = await _ends(history, known)
        if not 0 < (asked.after or 0) < deleted:
            break
        last = now  # retention has overtaken it meanwhile: what is found may lack what was to come first
    wanted = asked
    seen = last if more is None else more
    if more is None and items:
        seen = max(seen, items[-1][0])
    events = [(n, b"id: %d\ndata: %b\n\n" % (n, item)) for n, item in items]
    events += await _gaps(history, known, wanted.after or 0, seen)
    text = told + b"".join([event for _, event in sorted(events)])
    return text, replace(wanted, after=max(seen, wanted.after or 0)), more is not None


async def _ends(history: Reading, known: SessionRecord) -> tuple[int, int]:
    """The last verdict of a session that is deleted, and the last one that there is."""
    first, last = await history.extent(known.number)
    return (first - 1) * len(known.properties), last * len(known.properties)


async def _gaps(history: Reading, known: SessionRecord, after: int, seen: int) -> list[tuple[int, bytes]]:
    """What a client is told of verdicts that robots deleted before they forwarded them, each at its place.

    What is missing at the begin is not told to who asks from there.
    """
    size, told = len(known.properties), []
    for first, last in await history.missing(known):
        before, upto = (first - 1) * size, last * size
        if 0 < before < seen and after < upto:
            why = f"verdicts {before + 1} to {upto} were deleted at the robot before they were forwarded"
            told.append((upto, _missed_event(before, upto + 1, why)))
    return told


def _missed_event(after: int, next_: int, why: str) -> bytes:
    return format_sse_event(event="missed", data_str=encode({"after": after, "next": next_, "why": why}))


def _missed(wanted: Question, deleted: int, last: int) -> tuple[bytes, Question]:
    """What a client is told that can't go on where it was, and what is asked for in place of that.

    Verdicts are kept from behind `deleted` up to the `last` one.
    """
    after = wanted.after or 0
    if after > last:  # of a history that was lost, or of a session that was deleted
        why = f"there is no verdict {after}: another session of this name is told from its begin on"
        begin = 0
    elif 0 < after < deleted:
        why, begin = f"verdicts {after + 1} to {deleted} are not kept any more", deleted
    else:
        return b"", wanted
    return _missed_event(after, max(begin, deleted) + 1, why), replace(wanted, after=begin)
