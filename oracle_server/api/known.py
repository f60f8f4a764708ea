"""Looks up what a request names, and checks that the sender's token covers it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from functools import partial
from typing import Annotated, Any, NoReturn

from fastapi import HTTPException
from pydantic import Field
from starlette.requests import HTTPConnection

from oracle_server.core.errors import OracleError
from oracle_server.core.nearest import either, nearest
from oracle_server.edge.access import demand, grant_of
from oracle_server.edge.tokens import Grant
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord
from oracle_server.history.views import Doubts
from oracle_server.history.whose import Whose
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.runs import beginning
from oracle_server.sessions.summary import told
from oracle_server.specfiles.library import UnknownSpecError
from oracle_server.specfiles.load import parse_spec


async def covered(grant: Grant, history: Reading, origin: str | None = None) -> Whose:
    """The sessions that a grant is valid for, and those in which these go on; or of these a robot's."""
    if grant.sessions is None:
        return Whose(grant.specs, None, origin)
    later = [name for session in grant.sessions for name in await history.names(beginning(session))]
    return Whose(grant.specs, grant.sessions | frozenset(filter(grant.covers_session, later)), origin)


async def demand_session(connection: HTTPConnection, registry: Registry, session_id: str) -> SessionRecord:
    """The record of a session that the sender's token covers. Raises 404 or 403."""
    known = await registry.known(session_id)
    demand(connection, spec=known and known.spec, session=session_id)
    return known or unknown_session(session_id)


def demand_properties(known: SessionRecord, asked: Iterable[str]) -> None:
    """Raise 422 for a property that a session does not have: that nothing is found of it would be no good news."""
    for name in asked:
        if name not in known.properties:
            says = nearest(name, known.properties) or f"there are {either(known.properties)}"
            raise HTTPException(422, f"query.property: {known.spec} has no property `{name}`; {says}")


async def demand_stream(registry: Registry, history: Reading, known: SessionRecord, asked: str | None) -> None:
    """Raise 422 for the name of a stream that a session's spec does not have, as far as this version reads that."""
    if not asked:  # ticks have a stream without a name
        return
    live = registry.open.get(known.id)
    with contextlib.suppress(OracleError):
        read = partial(parse_spec, known.text, known.id, bounded=False)
        spec = live.spec if live else (await history.in_thread(read)).spec
        names = dict.fromkeys(stream.key.name for stream in spec.streams)
        if asked not in names:
            says = nearest(asked, names) or f"there are {either(names)}"
            raise HTTPException(422, f"query.stream: {known.spec} has no stream `{asked}`; {says}")


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


KeptFrom = Annotated[
    int | None,
    Field(
        description="The `n` of the session's first record that is kept, whatever is asked for: what was violated "
        "before it is not among these. Null where none is kept, or there is none"
    ),
]


async def kept_from(history: Reading, known: SessionRecord) -> int | None:
    """From which verdict on a session's records are kept; None where there are none."""
    first, last = await history.extent(known.number)
    return (first - 1) * len(known.properties) + 1 if first <= last else None


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
