"""What a server does all the time that shares its history: it takes over from others, or lets go for them."""

from __future__ import annotations

import asyncio

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.port import History
from oracle_server.sessions.registry import Registry

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
