"""Episodes over HTTP: those of one session, and those of all that the sender's token covers."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal

from fastapi import Depends, HTTPException, Query, Request, Response
from fastapi.responses import StreamingResponse
from fastapi.sse import EventSourceResponse
from pydantic import BaseModel, Field

from oracle_server.api.beginnings import episode_events
from oracle_server.api.following import STREAMED
from oracle_server.api.known import KeptFrom, covered, demand_properties, demand_session, kept_from
from oracle_server.api.leaving import unless_left
from oracle_server.api.packing import tagged_answer
from oracle_server.api.questions import Origin, Properties, demand_span
from oracle_server.api.routes import Routes
from oracle_server.core.events import Order
from oracle_server.edge.access import grant_of
from oracle_server.edge.scopes import needs
from oracle_server.history.episodes import Cursor, EpisodeQuery
from oracle_server.history.port import History
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.elsewhere import OtherServerError
from oracle_server.sessions.registry import Registry
from oracle_server.wire.json import encode_bytes

Time = Annotated[int | None, Query(ge=0, lt=2**63)]


class EpisodeModel(BaseModel):
    """Violations of a property that follow each other closely; times in nanoseconds."""

    session: str
    spec: str
    property: str
    order: Order
    first: int = Field(description="The n of the verdict that violates first")
    began: int = Field(description="Its time")
    last: int | None = Field(description="The n of the verdict that violates last; null while it is open")
    until: int | None = Field(description="Its time; null while it is open")
    open: bool = Field(description="Whether the property was not known to hold since")
    final: bool = Field(description="Whether it is violated for good")
    count: int = Field(description="How many violations it is")
    worst: dict[str, Any] | None = Field(
        description="The least `robustness`, or the `value` of a `signal` furthest from its `bound` while the property "
        "was negative; of an open one, as it was when it last grew by a tenth"
    )
    explanation: str | None = Field(description="Why the first verdict is negative")


class EpisodePage(BaseModel):
    """A page of episodes."""

    items: list[EpisodeModel]
    next: str | None = Field(description="The `after` of the following page; null where there are no more")


class SessionEpisodePage(EpisodePage):
    """A page of a session's episodes: one that ended before the first verdict that is kept is not kept, either."""

    kept_from: KeptFrom


def wanted(
    property: Properties,  # noqa: A002 -- the contract's word
    since: Annotated[Time, Query(description="Those that were not over before this time in ns")] = None,
    until: Annotated[Time, Query(description="Those that had begun by this time in ns")] = None,
    open: Annotated[bool | None, Query(description="Only those that are open, or that are not")] = None,  # noqa: A002
    after: Annotated[str | None, Query(max_length=160, description="The `next` of the page before")] = None,
    limit: Annotated[int, Query(ge=1, le=1000, description="Episodes in one answer")] = 100,
    order: Annotated[Literal["asc", "desc"], Query(description="The oldest or the newest first, by `began`")] = "asc",
) -> EpisodeQuery:
    """The question for one page of episodes. Raises 422 for a time that ends before it begins."""
    demand_span(since, until)
    cursor = None if after is None else Cursor.parse(after)
    if after is not None and cursor is None:
        raise HTTPException(422, "after: not the `next` of a page of episodes")
    return EpisodeQuery(None, frozenset(property), since, until, open, cursor, limit, order)


def router(registry: Registry, history: History) -> Routes:
    """The routes of episodes."""
    routes = Routes(prefix="/api/v1", tags=["verdicts"])

    async def page(request: Request, query: EpisodeQuery, known: SessionRecord | None = None) -> Response:
        items, after = await unless_left(request, history.episodes(query))
        document: dict[str, object] = {"items": items, "next": None if after is None else after.written()}
        if known is not None:
            document["kept_from"] = await kept_from(history, known)
        return await tagged_answer(request, history, partial(encode_bytes, document))

    @routes.get("/episodes", response_model=EpisodePage)
    @needs("read")
    async def list_all_episodes(
        request: Request, query: Annotated[EpisodeQuery, Depends(wanted)], origin: Origin = None
    ) -> Response:
        """List the episodes of all sessions that the token covers, open and closed ones. The answer has an `ETag`."""
        return await page(request, replace(query, whose=await covered(grant_of(request), history, origin)))

    @routes.get("/sessions/{session_id}/episodes", response_model=SessionEpisodePage)
    @needs("read")
    async def list_episodes(
        request: Request, session_id: str, query: Annotated[EpisodeQuery, Depends(wanted)]
    ) -> Response:
        """List the episodes of a session. The answer has an `ETag`."""
        known = await demand_session(request, registry, session_id)
        demand_properties(known, query.properties)
        return await page(request, replace(query, session=known.number), known)

    @routes.get(
        "/sessions/{session_id}/episodes/stream",
        response_class=StreamingResponse,
        responses={
            200: {
                "content": {"text/event-stream": {}},
                "description": "Events `begun`, `ended`, `retracted`, each with an episode; `closed` is the last one",
            }
        },
    )
    @needs("read")
    async def stream_episodes(
        request: Request,
        session_id: str,
        property: Properties,  # noqa: A002
    ) -> EventSourceResponse:
        """Stream a session's episodes: those that are open or may go on, then what becomes of each.

        An episode has `begun`, with its explanation; `ended`, once it can't go on any more; or is `retracted`, since
        what came late leaves nothing of it. Where that only gives it another beginning it is `retracted` and has
        `begun` with `moved`. What a client misses while it is away is in the list; who is too slow is told anew what
        goes on.
        """
        known = await demand_session(request, registry, session_id)
        demand_properties(known, property)
        try:
            await registry.others.demand_own(session_id)
        except OtherServerError as error:
            raise HTTPException(409, f"{error}; only that one can tell its episodes as they begin and end") from None
        events = episode_events(registry, history, known, frozenset(property))
        return EventSourceResponse(events, headers=STREAMED)

    return routes
