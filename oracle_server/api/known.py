"""Looks up the session that a request names, and checks that the sender's token covers it."""

from __future__ import annotations

from typing import Any, NoReturn

from fastapi import HTTPException
from starlette.requests import HTTPConnection

from oracle_server.edge.access import demand
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.registry import Registry


async def demand_session(connection: HTTPConnection, registry: Registry, session_id: str) -> SessionRecord:
    """The record of a session that the sender's token covers. Raises 404 or 403."""
    known = await registry.known(session_id)
    demand(connection, spec=known and known.spec, session=session_id)
    return known or unknown_session(session_id)


async def state_of(registry: Registry, session_id: str) -> dict[str, Any]:
    """A session's state, as of its end where it is closed. Raises 404."""
    return await registry.state(session_id) or unknown_session(session_id)


def unknown_session(session_id: str) -> NoReturn:
    """Raise 404 for a session."""
    raise HTTPException(404, f"no session '{session_id}' is known")
