"""Sessions that a request names: known to the server, and within what its sender's token is bound to."""

from __future__ import annotations

from typing import Any, NoReturn

from fastapi import HTTPException
from starlette.requests import HTTPConnection

from oracle_server.edge.access import demand
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.registry import Registry


async def demand_session(connection: HTTPConnection, registry: Registry, session_id: str) -> SessionRecord:
    """A session that is known and that the sender's token covers. Raises 404 or 403."""
    known = await registry.known(session_id)
    demand(connection, spec=known and known.spec, session=session_id)
    return known or unknown_session(session_id)


async def state_of(registry: Registry, session_id: str) -> dict[str, Any]:
    """How a session stands, or stood when it was closed. Raises 404."""
    return await registry.state(session_id) or unknown_session(session_id)


def unknown_session(session_id: str) -> NoReturn:
    """Raise 404."""
    raise HTTPException(404, f"no session '{session_id}' is known")
