"""Sessions over HTTP: listed, opened, shown, and closed."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Annotated, Any

from fastapi import Body, HTTPException, Query, Request, Response
from pydantic import BaseModel, ConfigDict

from oracle_server.api.known import covered, demand_name, demand_session, state_of, unknown_spec
from oracle_server.api.packing import json_answer, tagged_answer
from oracle_server.api.questions import Origin
from oracle_server.api.routes import Routes
from oracle_server.edge.access import demand, grant_of
from oracle_server.edge.scopes import needs
from oracle_server.history.port import History
from oracle_server.sessions.elsewhere import OtherServerError
from oracle_server.sessions.opening import SessionExistsError, SessionNameError
from oracle_server.sessions.registry import Registry, SessionStaysOpenError
from oracle_server.sessions.summary import brief, told
from oracle_server.specfiles.library import UnknownSpecError
from oracle_server.wire.incoming import Identifier
from oracle_server.wire.json import encode_bytes

_COMMIT_WITHIN = _CLOSE_WITHIN = 10.0
"""Seconds for a session to be committed, or closed, before a request is answered by 503."""


class NewSession(BaseModel):
    """The body of POST /sessions."""

    model_config = ConfigDict(extra="forbid")

    spec: Identifier
    id: Identifier | None = None


class SessionList(BaseModel):
    """The states of sessions."""

    items: list[dict[str, Any]]


def router(registry: Registry, history: History) -> Routes:
    """The routes of the sessions."""
    routes = Routes(prefix="/api/v1", tags=["sessions"])

    @routes.get("/sessions", response_model=SessionList)
    @needs("read")
    async def list_sessions(
        request: Request,
        short: Annotated[bool, Query(alias="brief", description="Of each what a list shows")] = False,
        origin: Origin = None,
    ) -> Response:
        """List all sessions, open ones first; in brief, what a list of many shows of each. The answer has an `ETag`."""
        grant = grant_of(request)
        states = await registry.states(await covered(grant, history, origin))
        seen = [s for s in states if grant.covers(spec=s["spec"], session=s["id"])]
        return await tagged_answer(request, history, partial(_listed, seen, short))

    @routes.post("/sessions", status_code=201, response_model=dict[str, Any])
    @needs("submit")
    async def create_session(wanted: Annotated[NewSession, Body()], request: Request) -> Response:
        """Open a session that monitors can attach to by its name; it stays open when the server restarts."""
        demand(request, spec=wanted.spec, session=wanted.id)
        await demand_name(request, registry, wanted.id)
        try:
            session = await registry.create(wanted.spec, wanted.id)
        except UnknownSpecError as error:
            unknown_spec(request, error)
        except (SessionExistsError, SessionNameError) as error:
            raise HTTPException(409 if isinstance(error, SessionExistsError) else 422, str(error)) from None
        try:
            async with asyncio.timeout(_COMMIT_WITHIN):
                await history.flush()
        except TimeoutError:
            raise HTTPException(503, "the history can't be written; the session is open, but not stored yet") from None
        session.keeping.check()
        return await _written(registry, session.id, 201)

    @routes.get("/sessions/{session_id}", response_model=dict[str, Any])
    @needs("read")
    async def get_session(session_id: str, request: Request) -> Response:
        """Get a session's state."""
        await demand_session(request, registry, session_id)
        return await json_answer(request, history, await state_of(registry, session_id))

    @routes.delete("/sessions/{session_id}", response_model=dict[str, Any])
    @needs("admin")
    async def close_session(session_id: str, request: Request) -> Response:
        """Judge all held events of a session, and close it; its history is kept.

        One that could not be restored is closed as it stands.
        """
        await demand_session(request, registry, session_id)
        try:
            closed = await registry.end(session_id, _CLOSE_WITHIN)
        except (OtherServerError, SessionStaysOpenError) as error:
            raise HTTPException(409 if isinstance(error, OtherServerError) else 500, str(error)) from None
        if not closed:
            raise HTTPException(503, "the history can't be written; the session is closed as soon as it can be")
        return await _written(registry, session_id, 200)

    return routes


async def _written(registry: Registry, session_id: str, status: int) -> Response:
    """The state of a session that was opened or closed; who does so waits for nobody that reads."""
    content = await asyncio.to_thread(encode_bytes, await state_of(registry, session_id))
    return Response(content, status, media_type="application/json")


def _listed(states: list[dict[str, Any]], short: bool) -> bytes:
    return encode_bytes({"items": [(brief if short else told)(state) for state in states]})
