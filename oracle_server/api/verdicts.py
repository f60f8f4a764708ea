"""A session's verdicts over HTTP: its records, its violations, the explanation of one, and the session's trace."""

from __future__ import annotations

from collections.abc import AsyncGenerator, AsyncIterator, Sequence
from contextlib import aclosing
from dataclasses import replace
from functools import partial
from typing import Annotated

from fastapi import Depends, HTTPException, Request, Response
from fastapi import Path as PathParameter
from pydantic import BaseModel, Field
from starlette.responses import StreamingResponse

from oracle_server.api.explaining import Explainer
from oracle_server.api.known import (
    KeptFrom,
    demand_properties,
    demand_session,
    demand_stream,
    doubts_of,
    kept_from,
    unknown_verdict,
)
from oracle_server.api.leaving import unless_left
from oracle_server.api.packing import json_answer, packed_answer
from oracle_server.api.questions import As, Outcomes, paged
from oracle_server.api.routes import Routes
from oracle_server.edge.scopes import needs
from oracle_server.history.pages import find
from oracle_server.history.port import History
from oracle_server.history.query import Query as Question
from oracle_server.review.again import NoExplanationError
from oracle_server.review.changes import changed_records
from oracle_server.review.trace import trace_lines
from oracle_server.sessions.registry import Registry
from oracle_server.wire.json import encode_bytes
from oracle_server.wire.outgoing import Record

_CHUNK = 100
"""Lines of a trace that are sent at once."""
_LONG = 2**18
"""Bytes beyond which these are fewer: the event loop copies what is sent."""

_NO_END = "by HTTP/1.0 a download that is cut off looks complete: ask by HTTP/1.1; of a proxy between, nginx needs " + (
    "`proxy_http_version 1.1`"
)


class RecordPage(BaseModel):
    """A page of records."""

    items: list[Record]
    next: int | None = Field(description="The `after` of the following page; null where there are no more records")
    kept_from: KeptFrom


def router(registry: Registry, history: History, explainer: Explainer) -> Routes:
    """The routes of a session's history."""
    routes = Routes(prefix="/api/v1", tags=["verdicts"])

    async def page(request: Request, session_id: str, question: Question) -> Response:
        known = await demand_session(request, registry, session_id)
        demand_properties(known, question.properties)
        await demand_stream(registry, history, known, question.stream)
        items, after = await unless_left(request, find(history, known, question, doubts_of(registry, session_id)))
        kept = await kept_from(history, known)
        return await packed_answer(
            request,
            history,
            lambda: (
                b'{"items":[%b],"next":%b,"kept_from":%b}'
                % (b",".join([text for _, text in items]), encode_bytes(after), encode_bytes(kept))
            ),
        )

    @routes.get("/sessions/{session_id}/verdicts", response_model=RecordPage)
    @needs("read")
    async def list_verdicts(
        request: Request, session_id: str, question: Annotated[Question, Depends(paged)], outcome: Outcomes
    ) -> Response:
        """List verdict records; `since` and `until` bound the publication time in ns (if `skewed`, the arrival)."""
        return await page(request, session_id, replace(question, outcomes=frozenset(outcome)))

    @routes.get("/sessions/{session_id}/violations", response_model=RecordPage)
    @needs("read")
    async def list_violations(
        request: Request, session_id: str, question: Annotated[Question, Depends(paged)]
    ) -> Response:
        """List the verdicts at which a property became negative, with their explanations.

        With `as=all`, revisions too by which one appears, or is `retracted`.
        """
        return await page(request, session_id, replace(question, violations=True))

    @routes.get("/sessions/{session_id}/verdicts/{n}/explanation", response_model=Record)
    @needs("read")
    async def explain_verdict(
        request: Request, session_id: str, n: Annotated[int, PathParameter(ge=1, lt=2**63)], view: As = "standing"
    ) -> Response:
        """Get any verdict with its explanation, for which all events before it are judged again.

        It is explained as it stands, unless what was said at first is asked for.

        This may take minutes. It is cancelled when the client disconnects. 503 where too many requests wait.
        """
        known = await demand_session(request, registry, session_id)
        try:
            record = await explainer.explained(request, known.number, n, view)
        except NoExplanationError as error:
            raise HTTPException(409, str(error)) from None
        if record is None:
            await unknown_verdict(history, known, n)
        return await json_answer(request, history, record)

    @routes.get(
        "/sessions/{session_id}/trace",
        response_class=StreamingResponse,
        responses={200: {"content": {"application/jsonl": {}}}},
    )
    @needs("read")
    async def get_trace(request: Request, session_id: str) -> StreamingResponse:
        """Get the session's trace as JSON Lines, in the order of arrival; `replay` reads it."""
        known = await demand_session(request, registry, session_id)
        return await _json_lines(request, history, trace_lines(history, known.number))

    @routes.get(
        "/sessions/{session_id}/changes",
        response_class=StreamingResponse,
        responses={200: {"content": {"application/jsonl": {}}, "description": "Verdict records, one a line"}},
    )
    @needs("read")
    async def get_changes(request: Request, session_id: str) -> StreamingResponse:
        """Get the verdict records, as they stand, at which a property's outcome, `degraded` or robustness is new.

        As JSON Lines, in the sequence in which they were judged, with each violation, the first record of each property
        and its last: what there is to draw, without the many records between at which nothing changed.
        """
        known = await demand_session(request, registry, session_id)
        return await _json_lines(request, history, changed_records(history, known))

    return routes


async def _json_lines(
    request: Request, history: History, pages: AsyncGenerator[Sequence[object], None]
) -> StreamingResponse:
    """The lines of all pages. The first page is read before the answer begins: 503 where the history can't be read.

    505 by HTTP/1.0, in which a download that was cut off looks like a whole one.
    """
    if request.scope["http_version"] == "1.0":
        raise HTTPException(505, _NO_END)

    async def first() -> Sequence[object] | None:
        return await anext(pages, None)

    chunks = _chunks(history, await unless_left(request, first()), pages)
    return StreamingResponse(chunks, media_type="application/jsonl")


async def _chunks(
    history: History, first: Sequence[object] | None, pages: AsyncGenerator[Sequence[object], None]
) -> AsyncIterator[bytes]:
    """The lines as text, some at once; the next ones are made when the client has read the last ones."""
    async with aclosing(pages):
        lines = first
        while lines is not None:
            at = 0
            while at < len(lines):
                text, at = await history.in_thread(partial(_joined, lines, at))
                yield text
            lines = await anext(pages, None)


def _joined(lines: Sequence[object], at: int) -> tuple[bytes, int]:
    """The text of the next lines from a place on, and the place behind them."""
    text, end = bytearray(), min(at + _CHUNK, len(lines))
    while at < end and len(text) < _LONG:
        text += encode_bytes(lines[at]) + b"\n"
        at += 1
    return bytes(text), at
