"""Looks up the session that a request names, and checks that the sender's token covers it."""

from __future__ import annotations

from typing import Any, NoReturn

from fastapi import HTTPException
from starlette.requests import HTTPConnection

from oracle_server.edge.access import demand, grant_of
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord
from oracle_server.history.views import Doubts
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.summary import told
from oracle_server.specfiles.library import UnknownSpecError


async def demand_session(connection: HTTPConnection, registry: Registry, session_id: str) -> SessionRecord:
    """The record of a session that the sender's token covers. Raises 404 or 403."""
    known = await registry.known(session_id)
    demand(connection, spec=known and known.spec, session=session_id)
    return known or unknown_session(session_id)


async def demand_name(connection: HTTPConnection, registry: Registry, session_id: str | None) -> None:
    """Raise 403 where a name is that of a session that the sender's token does not cover."""
    known = await registry.known(session_id) if session_id is not None else None
    if known is not None:
        demand(connection, spec=known.spec, session=known.id)


async def state_of(registry: Registry, session_id: str) -> dict[str, Any]:
    """A session's state, as of its end where it is closed. Raises 404."""
    return told(await registry.state(session_id) or unknown_session(session_id))


def doubts_of(registry: Registry, session_id: str) -> Doubts | None:
    """Which verdicts of a session may still be revised; None where none may: it is closed, or does not revise."""
    live = registry.open.get(session_id)
    return live.doubts if live else None


async def visible_specs(connection: HTTPConnection, registry: Registry) -> frozenset[str] | None:
    """The specs that the sender's token lets them see, None for all: those that it names, and its sessions' own."""
    grant = grant_of(connection)
    if grant.sessions is None:
        return grant.specs
    used = {session.spec.id for session in registry.open.values() if grant.covers_session(session.id)}
    used |= {one.record.spec for one in registry.recorded.values() if grant.covers_session(one.record.id)}
    for name in grant.sessions:
        known = await registry.known(name)
        used |= {known.spec} if known else set()
    return frozenset(used if grant.specs is None else used & grant.specs)


def unknown_spec(connection: HTTPConnection, error: UnknownSpecError) -> NoReturn:
    """Raise 404 for a spec; a token that is bound is not told which others there are."""
    raise HTTPException(404, error.brief if grant_of(connection).bound else str(error)) from None


async def unknown_verdict(history: Reading, known: SessionRecord, n: int) -> NoReturn:
    """Raise 410 for a verdict of a session that is not kept any more, 404 for one that there is not."""
    first, last = await history.extent(known.number)
    width = len(known.properties)
    if n <= (first - 1) * width:
        raise HTTPException(410, f"verdict {n} of session '{known.id}' is not kept any more")
    raise HTTPException(
        404, f"session '{known.id}' has no verdict {n} in its history{' yet' if n > last * width else ''}"
    )


def unknown_session(session_id: str) -> NoReturn:
    """Raise 404 for a session."""
    raise HTTPException(404, f"no session '{session_id}' is known")
