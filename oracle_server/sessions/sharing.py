"""What a server does all the time that shares its history: it takes over from others, or lets go for them."""

from __future__ import annotations

import asyncio

import structlog

from oracle_server.core.errors import HistoryError, OracleError
from oracle_server.history.port import History
from oracle_server.sessions.endings import DELETED_THERE
from oracle_server.sessions.registry import Registry

_CLOSE_WITHIN = 10.0
"""Seconds for a session to be closed of which nothing more will come."""

log = structlog.get_logger()


async def share(registry: Registry, history: History, every: float) -> None:
    """Look every so many seconds, for ever, whether another server's lease has run out, or this one's own."""
    failing = False
    while True:
        await asyncio.sleep(every)
        try:
            if history.adrift:
                registry.let_go()
            else:
                await registry.take_over()
            failing = False
        except HistoryError as error:
            if not failing and history.failure is None:  # else it is logged where it is written
                log.warning("it can't be seen whether other servers' leases have run out", reason=str(error))
                failing = True
        except Exception:  # without this task, nobody would go on with the sessions of a server that is gone
            log.exception("other servers' sessions can't be taken over now")


async def close_left(registry: Registry, history: History, every: float) -> None:
    """Close every so many seconds, for ever, the sessions that robots have deleted: else they would stay open."""
    while True:
        await asyncio.sleep(every)
        try:
            left = await history.left()
        except HistoryError as error:
            log.warning("sessions that robots have deleted can't be closed now", reason=str(error))
            continue
        for name in left:
            try:
                await registry.end(name, _CLOSE_WITHIN, DELETED_THERE)
                log.info("a session is closed that its robot has deleted", session=name)
            except OracleError as error:  # as where another server has just closed it
                log.warning("a session that its robot has deleted can't be closed now", session=name, reason=str(error))
            except Exception:  # without this task, the others would never be deleted
                log.exception("a session that its robot has deleted can't be closed now", session=name)
