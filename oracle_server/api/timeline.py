"""A session by time over HTTP: what went on in each bucket of a window."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Annotated

import msgspec
from fastapi import Depends, Header, HTTPException, Query, Request, Response
from fastapi.responses import StreamingResponse
from fastapi.sse import EventSourceResponse, format_sse_event
from pydantic import BaseModel, Field, StringConstraints

from oracle_server.api.following import STREAMED, followed, number_of
from oracle_server.api.known import demand_session
from oracle_server.api.leaving import unless_left
from oracle_server.api.packing import packed_answer
from oracle_server.api.questions import Nanoseconds, demand_span
from oracle_server.api.routes import Routes
from oracle_server.core.errors import UnpreparedError
from oracle_server.core.kinds import RESERVED
from oracle_server.core.nearest import either, nearest
from oracle_server.edge.scopes import needs
from oracle_server.history.columns import PARTS, Part
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord
from oracle_server.history.timeline import NOTHING_NEW, Question
from oracle_server.sessions.registry import Registry
from oracle_server.wire.json import encode_bytes

MOST_BYTES = 2**20
"""Of an answer: a page shows no more of it than has room there."""
_EVERY = 0.25
"""Seconds between two timelines of a stream."""
_AGAIN = 60
"""Seconds after which a client may ask again where a timeline is still made."""


MOST_BUCKETS, MOST_SIGNALS = 2_000, 8
SignalName = Annotated[str, StringConstraints(pattern=r"^[^:]+:[^:]+$", max_length=500)]


def _all() -> list[Part]:
    """All parts; and no signals: of `list` itself pydantic would parse a signature at each request."""
    return list(PARTS)


def _none() -> list[str]:
    return []


Parts = Annotated[list[Part], Query(alias="part", default_factory=_all, description="Only these; repeatable")]
Signals = Annotated[
    list[SignalName],
    Query(
        default_factory=_none,
        max_length=MOST_SIGNALS,
        description="Signals, as `STREAM:SIGNAL` with the stream as in `streams`; repeatable",
    ),
]


class StreamColumns(BaseModel):
    """What came on a stream."""

    count: list[int]
    lost: list[int] = Field(description="Messages that are known to be lost")


class Holds(BaseModel):
    """How long events that were asked about waited to be judged (ns); 0 where none was."""

    mean: list[int]
    max: list[int]


class SignalColumns(BaseModel):
    """A signal's values: numbers, with `true` and `false` as 1 and 0, and texts."""

    count: list[int] = Field(description="How many were numbers")
    min: list[float | None]
    max: list[float | None]
    mean: list[float | None]
    text: list[str | None] = Field(description="The text, where there was one alone")
    several: list[bool] = Field(description="Whether there were several texts, or one of more than 100 characters")


class Timeline(BaseModel):
    """A window of a session in buckets, by columns with an entry a bucket; only the parts that were asked for.

    A step's time is its publication time, or the latest of a step before it, where that is later: what came late is
    where it was judged. What is counted in all buckets together is exact; in each it may be one bucket early.
    """

    since: int = Field(description="Where the first bucket begins (ns): a multiple of the width")
    width: int = Field(description="Of a bucket (ns): 1, 2 or 5 times a power of ten")
    buckets: int
    position: int = Field(description="Of the session's last row that was looked at")
    first: int | None = Field(description="The time of the session's first step (ns); null where there is none")
    last: int | None = Field(description="The time of its last step (ns)")
    lanes: dict[str, str] = Field(
        {},
        description="By property a character a bucket, the worst outcome: T true, t currently true, u unknown, "
        "f currently false, F false, - a deadline that does not stand, a space where there is no step",
    )
    degraded: dict[str, str] = Field({}, description="By property a character a bucket: 1 degraded, 0 not")
    violations: dict[str, list[int]] = Field({}, description="By property")
    steps: list[int] = Field([], description="Events and deadlines that were judged")
    late: list[int] = Field([], description="Of these, those that came late")
    streams: dict[str, StreamColumns] = Field({}, description="By stream: its name, and its kind for one of several")
    asked: list[int] = []
    denied: list[int] = []
    hold: Holds | None = Field(None, description="Null where it is not known: the session is in simulated time")
    signals: dict[str, SignalColumns] = {}


def router(registry: Registry, history: Reading) -> Routes:
    """The route of timelines."""
    routes = Routes(prefix="/api/v1", tags=["verdicts"])

    @routes.get("/sessions/{session_id}/timeline", response_model=Timeline)
    @needs("read")
    async def get_timeline(
        request: Request, session_id: str, question: Annotated[Question, Depends(asked)]
    ) -> Response:
        """Get what went on by time: each property's outcomes, violations, streams, decisions and signals in buckets.

        The buckets are the narrowest ones of which so many cover the window; without `since` or `until` it is the
        session's own. 422 where the answer would have more than 1 MiB; 503 while the timeline of a session that an
        older version wrote is made.
        """
        known = await demand_session(request, registry, session_id)
        _demand_signals(registry, session_id, question)
        try:
            body = await unless_left(request, history.timeline(known, question))
        except UnpreparedError as error:
            raise HTTPException(503, str(error), {"Retry-After": str(_AGAIN)}) from None
        if len(body) > MOST_BYTES:
            detail = (
                f"the answer has {len(body)} bytes, and may have {MOST_BYTES}: ask for fewer buckets, parts or signals"
            )
            raise HTTPException(422, detail)
        return await packed_answer(request, history, lambda: body)

    @routes.get(
        "/sessions/{session_id}/timeline/stream",
        response_class=StreamingResponse,
        responses={200: {"content": {"text/event-stream": {}}, "description": "Timelines; the id is their position"}},
    )
    @needs("read")
    async def stream_timeline(
        request: Request,
        session_id: str,
        question: Annotated[Question, Depends(followed_by)],
        last_event_id: Annotated[str | None, Header(description="The id of the last event that was read")] = None,
    ) -> EventSourceResponse:
        """Stream what has changed since `after` or Last-Event-ID: whole buckets, as a timeline from the first of them.

        At most four a second come, the event `closed` is the last one. Where too much has changed, or `after` is of
        another session that had the name, there is `again` with the `position`, and no bucket: ask for the timeline
        anew.
        """
        known = await demand_session(request, registry, session_id)
        _demand_signals(registry, session_id, question)
        since = question.after if last_event_id is None else number_of(last_event_id)
        events = _events(registry, history, known, replace(question, after=since))
        return EventSourceResponse(events, headers=STREAMED)

    return routes


def _demand_signals(registry: Registry, session_id: str, question: Question) -> None:
    """Raise 422 for a signal that no stream of an open session has, as far as its spec tells which ones they have."""
    live = registry.open.get(session_id)
    if live is None or not question.signals:
        return
    streams = {str(stream.key): stream for stream in live.spec.streams}
    for signal in question.signals:
        name, _, own = signal.partition(":")
        stream = streams.get(name)
        if stream is None:
            says = nearest(name, streams) or f"these are {either(streams)}"
            raise HTTPException(422, f"query.signal: {live.spec.id} has no stream `{name}`; {says}")
        if stream.signals is None or own in live.spec.kept | RESERVED or own in stream.traits.marks:
            continue
        if own not in stream.signals:
            says = nearest(own, stream.signals) or f"there are {either(stream.signals) or 'none'}"
            raise HTTPException(422, f"query.signal: {name} has no signal `{own}`; {says}")


class _Place(msgspec.Struct):
    position: int


_place = msgspec.json.Decoder(_Place).decode


async def _events(registry: Registry, history: Reading, known: SessionRecord, wanted: Question) -> AsyncIterator[bytes]:
    yield format_sse_event(comment="the timeline of a session")
    asked = wanted

    async def page() -> tuple[bytes, bool]:
        nonlocal asked
        body = await history.timeline(known, asked)
        if body == NOTHING_NEW:
            return b"", False
        asked = replace(asked, after=_place(body).position)
        if len(body) > MOST_BYTES:
            body = encode_bytes({"position": asked.after, "again": True})
        return format_sse_event(data_str=body.decode(), id=str(asked.after)), False

    async for text in followed(registry, known.id, page, _EVERY):
        yield text


def followed_by(
    wanted: Parts,
    signal: Signals,
    width: Annotated[int, Query(ge=1, lt=2**63, description="Of the buckets (ns): 1, 2 or 5 times a power of ten")],
    after: Annotated[int, Query(ge=0, lt=2**63, description="The `position` of the last timeline that was read")] = 0,
) -> Question:
    """The question for what changes in buckets of a width."""
    if str(width).rstrip("0") not in ("1", "2", "5"):
        raise HTTPException(422, "query.width: it is not 1, 2 or 5 times a power of ten; take that of a timeline")
    return Question(None, None, MOST_BUCKETS, frozenset(wanted), tuple(dict.fromkeys(signal)), after, width)


def asked(
    wanted: Parts,
    signal: Signals,
    since: Nanoseconds = None,
    until: Nanoseconds = None,
    buckets: Annotated[int, Query(ge=1, le=MOST_BUCKETS, description="The most buckets")] = 1000,
) -> Question:
    """The question for a window."""
    demand_span(since, until)
    return Question(since, until, buckets, frozenset(wanted), tuple(dict.fromkeys(signal)))
