"""The HTTP API and the WebSocket's address: routes and nothing else."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import aclosing
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Body, FastAPI, HTTPException, Query, Request, Response, WebSocket
from fastapi import Path as PathParameter
from pydantic import BaseModel, ConfigDict
from starlette.requests import ClientDisconnect
from starlette.responses import StreamingResponse

from oracle_server import __version__
from oracle_server.api import metrics, pages, stream
from oracle_server.attach.connection import Connection
from oracle_server.attach.rosmonitoring import legacy_routes
from oracle_server.core.errors import SpecError
from oracle_server.core.verdicts import Outcome
from oracle_server.edge import problems
from oracle_server.edge.access import demand, demand_session, demand_spec, grant_of, unknown_session
from oracle_server.history.pages import find
from oracle_server.history.port import History
from oracle_server.history.query import Query as Question
from oracle_server.process.watchdog import Watchdog
from oracle_server.review.explanation import NoExplanationError, explained
from oracle_server.review.trace import trace_lines
from oracle_server.sessions.registry import Registry, SessionExistsError
from oracle_server.specfiles.library import Entry, Library, UnknownSpecError
from oracle_server.wire.incoming import Identifier
from oracle_server.wire.json import encode, encode_bytes

Page = dict[str, Any]
_COMMIT_WITHIN = _CLOSE_WITHIN = 10.0
Nanoseconds = Annotated[int | None, Query(ge=0, lt=2**63)]


class NewSession(BaseModel):
    """What is asked for by POST /sessions."""

    model_config = ConfigDict(extra="forbid")

    spec: Identifier
    id: Identifier | None = None


def build_app(
    registry: Registry,
    library: Library,
    store: History,
    watchdog: Watchdog,
    *,
    legacy: str | None = None,
    max_rate: float = 0,
) -> FastAPI:
    """The app over a server's parts.

    `legacy` is the spec of the old monitors that name none; each monitor may send `max_rate` events a second, 0 for any
    number.
    """
    app = FastAPI(
        title="oracle-server", version=__version__, docs_url=None, redoc_url=None, responses=problems.RESPONSES
    )
    problems.install(app)
    app.include_router(_health(store))
    app.include_router(_specs(library), prefix="/api/v1", tags=["specs"])
    app.include_router(_sessions(registry, store), prefix="/api/v1", tags=["sessions"])
    app.include_router(_verdicts(registry, store), prefix="/api/v1", tags=["verdicts"])
    app.include_router(stream.router(registry, store), prefix="/api/v1", tags=["verdicts"])
    app.include_router(metrics.router(registry, store, watchdog))
    app.include_router(pages.router())

    app.include_router(legacy_routes(registry, legacy, max_rate))

    @app.websocket("/api/v1/attach")
    async def attach(socket: WebSocket) -> None:
        await Connection(socket, registry, max_rate).serve()

    return app


def _health(store: History) -> APIRouter:
    router = APIRouter(tags=["health"])

    @router.get("/healthz")
    async def alive() -> dict[str, str]:
        """Tell that the server runs."""
        return {"status": "ok"}

    @router.get("/readyz")
    async def ready() -> dict[str, str]:
        """Tell whether the server can judge."""
        if store.failure is not None:
            raise HTTPException(503, f"the history can't be written: {store.failure}")
        return {"status": "ready"}

    return router


def _specs(library: Library) -> APIRouter:
    router = APIRouter()

    def current(spec_id: str) -> Entry:
        try:
            return library.get(spec_id)
        except UnknownSpecError as error:
            raise HTTPException(404, str(error)) from None

    def listed(spec_id: str) -> dict[str, Any]:
        try:
            return described(library.get(spec_id))
        except SpecError as error:
            return described(library.last(spec_id)) | {"problem": str(error)}

    def described(entry: Entry) -> dict[str, Any]:
        spec = entry.plan.spec
        return {
            "id": spec.id,
            "description": spec.description,
            "digest": spec.digest,
            "source": entry.source,
            "streams": [{"name": s.name, "kind": s.kind, "type": s.type, "action": s.action} for s in spec.streams],
            "properties": [{"id": p.id, "description": p.description, "formula": p.text} for p in spec.properties],
        }

    @router.get("/specs")
    async def list_specs(request: Request) -> Page:
        """List the specs on hand; `problem` says why a file that has changed can't be used."""
        bound = grant_of(request).specs
        return {"items": [listed(spec_id) for spec_id in library.ids() if bound is None or spec_id in bound]}

    @router.get("/specs/{spec_id}")
    async def get_spec(spec_id: str, request: Request) -> dict[str, Any]:
        """Tell what a spec says, with its text."""
        demand_spec(request, spec_id)
        entry = current(spec_id)
        return described(entry) | {"text": entry.file.text}

    @router.put("/specs/{spec_id}", openapi_extra={"requestBody": {"content": {"application/yaml": {}}}})
    async def put_spec(spec_id: Identifier, request: Request, response: Response) -> dict[str, Any]:
        """Validate a spec as `check` does, and take it in; sessions that are open keep theirs."""
        demand_spec(request, spec_id)
        entry, new = await asyncio.to_thread(library.put, spec_id, await _text(request))
        response.status_code = 201 if new else 200
        return described(entry) | {"warnings": [str(w) for w in entry.file.warnings]}

    return router


def _sessions(registry: Registry, store: History) -> APIRouter:
    router = APIRouter()

    @router.get("/sessions", response_model=Page)
    async def list_sessions(request: Request) -> Response:
        """List all sessions, open ones first."""
        grant, states = grant_of(request), await registry.states()
        told = {"items": [s for s in states if grant.covers(spec=s["spec"], session=s["id"])]}
        return Response(await asyncio.to_thread(encode_bytes, told), media_type="application/json")

    @router.post("/sessions", status_code=201)
    async def create_session(wanted: Annotated[NewSession, Body()], request: Request) -> dict[str, Any]:
        """Open a session that monitors can join by its name; a restarted server still has it."""
        demand(request, spec=wanted.spec, session=wanted.id)
        try:
            session = await registry.create(wanted.spec, wanted.id)
        except UnknownSpecError as error:
            raise HTTPException(404, str(error)) from None
        except SessionExistsError as error:
            raise HTTPException(409, str(error)) from None
        try:
            async with asyncio.timeout(_COMMIT_WITHIN):
                await store.flush()
        except TimeoutError:
            raise HTTPException(503, "the history can't be written; the session is open but not kept yet") from None
        return await registry.state(session.id) or {}

    @router.get("/sessions/{session_id}")
    async def get_session(session_id: str, request: Request) -> dict[str, Any]:
        """Tell how a session stands."""
        await demand_session(request, registry, session_id)
        return await registry.state(session_id) or unknown_session(session_id)

    @router.delete("/sessions/{session_id}")
    async def close_session(session_id: str, request: Request) -> dict[str, Any]:
        """Judge what a session holds, and close it; its history stays."""
        await demand_session(request, registry, session_id)
        session = registry.open.get(session_id)
        if session is not None and not await registry.closed_within(session, _CLOSE_WITHIN):
            raise HTTPException(503, "the history can't be written; the session is closed as soon as it can")
        return await registry.state(session_id) or unknown_session(session_id)

    return router


def _verdicts(registry: Registry, store: History) -> APIRouter:
    router = APIRouter()
    explaining = asyncio.Lock()

    async def page(request: Request, session_id: str, question: Question) -> Page:
        known = await demand_session(request, registry, session_id)
        items, after = await find(store, known, question)
        return {"items": items, "next": after}

    @router.get("/sessions/{session_id}/verdicts")
    async def list_verdicts(
        request: Request,
        session_id: str,
        property: Annotated[list[str], Query()] = [],  # noqa: A002, B006 -- the contract's word; never changed
        outcome: Annotated[list[Outcome], Query()] = [],  # noqa: B006
        stream: str | None = None,
        since: Nanoseconds = None,
        until: Nanoseconds = None,
        after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
        limit: Annotated[int, Query(ge=1, le=1000)] = 100,
        order: Literal["asc", "desc"] = "asc",
    ) -> Page:
        """The verdict history; `since` and `until` bound the publication time in nanoseconds."""
        wanted = frozenset(property), frozenset(outcome)
        return await page(request, session_id, Question(*wanted, stream, since, until, after, limit, order))

    @router.get("/sessions/{session_id}/verdicts/{n}/explanation")
    async def explain_verdict(
        request: Request, session_id: str, n: Annotated[int, PathParameter(ge=1, lt=2**63)]
    ) -> dict[str, Any]:
        """A verdict with its explanation, positive ones too: all that came before is judged again, one at a time."""
        known = await demand_session(request, registry, session_id)
        try:
            async with explaining:
                record = await explained(store, known.number, n)
        except NoExplanationError as error:
            raise HTTPException(409, str(error)) from None
        if record is None:
            raise HTTPException(404, f"session '{session_id}' has no verdict {n} in its history yet")
        return record

    @router.get("/sessions/{session_id}/violations")
    async def list_violations(
        request: Request,
        session_id: str,
        property: Annotated[list[str], Query()] = [],  # noqa: A002, B006
        stream: str | None = None,
        since: Nanoseconds = None,
        until: Nanoseconds = None,
        after: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
        limit: Annotated[int, Query(ge=1, le=1000)] = 100,
        order: Literal["asc", "desc"] = "asc",
    ) -> Page:
        """The verdicts at which a property became negative, with their explanations."""
        question = Question(
            frozenset(property), frozenset(), stream, since, until, after, limit, order, violations=True
        )
        return await page(request, session_id, question)

    @router.get(
        "/sessions/{session_id}/trace",
        response_class=StreamingResponse,
        responses={200: {"content": {"application/jsonl": {}}}},
    )
    async def get_trace(request: Request, session_id: str) -> StreamingResponse:
        """Give what was judged as JSON Lines that `replay` takes: the events in the order of their arrival."""
        known = await demand_session(request, registry, session_id)
        return StreamingResponse(_lines(store, known.number), media_type="application/jsonl")

    return router


async def _lines(store: History, session: int) -> AsyncIterator[str]:
    async with aclosing(trace_lines(store, session)) as pages:
        async for lines in pages:
            yield "".join(encode(line) + "\n" for line in lines)


async def _text(request: Request) -> str:
    try:
        body = await request.body()
    except ClientDisconnect:
        raise HTTPException(400, "the client left in the middle") from None
    try:
        return body.decode()
    except UnicodeDecodeError:
        raise HTTPException(422, "not UTF-8 text") from None
