"""How open sessions are left, and why none is joined: the server stops or only reads, or another one may have them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Collection, Iterable

import structlog

from oracle_server.history.port import History
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Outbox
from oracle_server.wire.errors import WireError

_CLOSE_WITHIN = 2.0
"""Seconds for the connections to be closed when the server stops."""
_FLUSH_WITHIN = 10.0

log = structlog.get_logger()


def stops() -> WireError:
    """What monitors are told of a server that stops."""
    return WireError("shutting_down", "the server stops; attach again later", fatal=True)


def adrift() -> WireError:
    """What they are told of one that can't know whether it has their sessions still."""
    message = "the database does not answer this server, and another one may have the session: attach there"
    return WireError("history_unavailable", message, fatal=True)


def demand_keeping(history: History) -> None:
    """Raise a fatal `WireError` where this server only reads."""
    if history.read_only is not None:
        raise WireError("read_only", history.read_only, fatal=True)


def demand_having(history: History, *, stopping: bool) -> None:
    """Raise a fatal `WireError` where this server stops, or another one may have its sessions by now."""
    if stopping:
        raise stops()
    if history.adrift:
        raise adrift()


def let_go(sessions: Iterable[LiveSession], reason: WireError) -> list[Outbox]:
    """Drop all monitors; returns their connections."""
    outboxes = [m.outbox for session in sessions for m in session.monitors.values() if m.outbox]
    for outbox in outboxes:
        outbox.drop(reason)
    return outboxes


async def settle(sessions: Collection[LiveSession], history: History, within: float) -> None:
    """Judge what sessions hold, and commit it; in the history they stay open.

    Oracles elsewhere have `within` seconds to answer. A session that fails at that is logged, and left as the history
    has it: the next server restores it, as all others.
    """
    closed = []
    for session in [*sessions]:
        if _done(session, session.close):
            closed.append(session)
        await asyncio.sleep(0)  # so that decisions of others wait for one session, not for thousands
    ends = await asyncio.gather(*(session.settle(within) for session in closed), return_exceptions=True)
    for session, failure in zip(closed, ends, strict=True):
        if isinstance(failure, Exception):
            _tell(session, failure)
        else:
            _done(session, session.ledger.save)
        await asyncio.sleep(0)
    try:
        async with asyncio.timeout(_FLUSH_WITHIN):
            await history.flush()
    except TimeoutError:
        log.error("the server stops without its last events in the history; their monitors send them again")


def _done(session: LiveSession, work: Callable[[], object]) -> bool:
    """Whether a session's work was done; where it failed, that is logged."""
    try:
        work()
    except Exception as error:  # noqa: BLE001 -- no other session may be affected
        _tell(session, error)
        return False
    return True


def _tell(session: LiveSession, error: Exception) -> None:
    log.error("a session can't be left in order; it is restored from the history", session=session.id, exc_info=error)


async def leave(sessions: Collection[LiveSession]) -> None:
    """Close all connections."""
    for session in sessions:
        session.ledger.commits.end()
    outboxes = let_go(sessions, stops())
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_CLOSE_WITHIN):
            await asyncio.gather(*(outbox.sent() for outbox in outboxes))
