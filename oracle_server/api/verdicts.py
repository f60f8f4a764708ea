"""A session's verdict history over HTTP: its records, its violations, one verdict explained, and its trace."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Sequence
from contextlib import aclosing
from dataclasses import replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, HTTPException, Request, Response
from fastapi import Path as PathParameter
from pydantic import BaseModel, Field
from starlette.responses import StreamingResponse

from oracle_server.api.explaining import Explainer
from oracle_server.api.known import demand_session
from oracle_server.api.questions import Outcomes, paged
from oracle_server.core.events import Order
from oracle_server.core.kinds import RecordKind
from oracle_server.core.verdicts import Outcome
from oracle_server.edge.scopes import needs
from oracle_server.history.pages import find
from oracle_server.history.port import History
from oracle_server.history.query import Query as Question
from oracle_server.history.records import Document
from oracle_server.review.explanation import NoExplanationError
from oracle_server.review.trace import trace_lines
from oracle_server.sessions.registry import Registry
from oracle_server.wire.json import encode_bytes

_CHUNK = 100
"""Lines of a trace that are sent at once."""


class Record(BaseModel):
    """What one property said at one step, or at a deadline that ran out (`kind` is `tick`); times in nanoseconds."""

    n: int = Field(description="The number of the verdict in its session, without gaps")
    step: int | None = Field(description="The number of the step; null where the event was not judged")
    property: str
    order: Order
    outcome: Outcome
    stream: str
    kind: RecordKind
    monitor: str
    seq: int
    stamp: int = Field(description="When the event was published")
    arrived: int = Field(description="When it came, in the session's time")
    judged: int = Field(description="When it was judged, in the server's time")
    late: bool
    skewed: bool
    degraded: bool
    decision: Literal["allow", "deny"] | None
    passed: bool | None = Field(description="What the adapter did with an event that it asked about")
    robustness: float | Literal["Infinity", "-Infinity"] | None
    violation: bool = Field(description="Whether the property became negative here")
    explanation: dict[str, Any] | None


class RecordPage(BaseModel):
    """Records, and where to go on."""

    items: list[Record]
    next: int | None = Field(description="What to ask for as `after` to go on; null where there are no more")


def router(registry: Registry, history: History) -> APIRouter:
    """The routes of a session's history."""
    made = APIRouter(prefix="/api/v1", tags=["verdicts"])
    explainer = Explainer(history)

    async def page(request: Request, session_id: str, question: Question) -> Response:
        known = await demand_session(request, registry, session_id)
        items, after = await find(history, known, question)
        made = await asyncio.to_thread(encode_bytes, {"items": items, "next": after})  # a thousand take their time
        return Response(made, media_type="application/json")

    @made.get("/sessions/{session_id}/verdicts", response_model=RecordPage)
    @needs("read")
    async def list_verdicts(
        request: Request, session_id: str, question: Annotated[Question, Depends(paged)], outcome: Outcomes
    ) -> Response:
        """The verdict history; `since` and `until` bound the publication time in nanoseconds."""
        return await page(request, session_id, replace(question, outcomes=frozenset(outcome)))

    @made.get("/sessions/{session_id}/violations", response_model=RecordPage)
    @needs("read")
    async def list_violations(
        request: Request, session_id: str, question: Annotated[Question, Depends(paged)]
    ) -> Response:
        """The verdicts at which a property became negative, with their explanations."""
        return await page(request, session_id, replace(question, violations=True))

    @made.get("/sessions/{session_id}/verdicts/{n}/explanation", response_model=Record)
    @needs("read")
    async def explain_verdict(
        request: Request, session_id: str, n: Annotated[int, PathParameter(ge=1, lt=2**63)]
    ) -> Response:
        """A verdict with its explanation, positive ones too: all that came before is judged again, one at a time.

        It may take minutes; it is given up when the client leaves. 503 where too many are waited for.
        """
        known = await demand_session(request, registry, session_id)
        try:
            record = await explainer.explained(request, known.number, n)
        except NoExplanationError as error:
            raise HTTPException(409, str(error)) from None
        if record is None:
            raise HTTPException(404, f"session '{session_id}' has no verdict {n} in its history yet")
        return Response(encode_bytes(record), media_type="application/json")

    @made.get(
        "/sessions/{session_id}/trace",
        response_class=StreamingResponse,
        responses={200: {"content": {"application/jsonl": {}}}},
    )
    @needs("read")
    async def get_trace(request: Request, session_id: str) -> StreamingResponse:
        """Give what was judged as JSON Lines that `replay` takes: the events in the order of their arrival."""
        known = await demand_session(request, registry, session_id)
        return StreamingResponse(_json_lines(trace_lines(history, known.number)), media_type="application/jsonl")

    return made


async def _json_lines(pages: AsyncGenerator[list[Document], None]) -> AsyncIterator[bytes]:
    """Pages of lines as pieces of some size, for each of which the reader is waited for."""
    async with aclosing(pages):
        async for lines in pages:
            for start in range(0, len(lines), _CHUNK):
                yield await asyncio.to_thread(_joined, lines[start : start + _CHUNK])


def _joined(lines: Sequence[Document]) -> bytes:
    return b"".join(encode_bytes(line) + b"\n" for line in lines)
