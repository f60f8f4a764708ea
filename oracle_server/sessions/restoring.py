"""Sessions that the history has open, brought back: at the start, and where another server's are taken over."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, MutableMapping

import structlog

from oracle_server.core.errors import OracleError, UnansweredError
from oracle_server.core.plan import Plan
from oracle_server.history.port import History
from oracle_server.history.records import SessionRecord
from oracle_server.process.clock import Clock
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.plans import Plans
from oracle_server.sessions.recorded import CUT_OFF, cut_off
from oracle_server.sessions.unrestored import Unrestored
from oracle_server.specfiles.library import Library

log = structlog.get_logger()


class Restoring:
    """Restores sessions one by one, each by `restore`, into those that are open or could not be restored."""

    def __init__(
        self, history: History, library: Library, clock: Clock, open_: MutableMapping[str, LiveSession],
        unrestored: MutableMapping[str, Unrestored], restore: Callable[[SessionRecord, Plan], Awaitable[None]],
    ) -> None:  # fmt: skip
        self._history, self._library, self._clock = history, library, clock
        self._open, self._unrestored, self._restore = open_, unrestored, restore

    async def restore_each(self, sessions: list[SessionRecord]) -> None:
        """Restore sessions. One that can't be restored is logged, and among the unrestored.

        Raises `UnansweredError` where the history did not answer: nothing is wrong with the session, and it is neither
        open nor unrestored.
        """
        plans = Plans(await self._library.in_thread(self._library.listed))
        for opened in sessions:
            try:
                if opened.kind == "recording":
                    await self._close(opened)
                else:
                    await self._restore(opened, await asyncio.to_thread(plans.of, opened))
                    self._history.trouble(opened.number, None)
            except UnansweredError as error:
                self._forget(opened.id)
                log.warning("a session is not restored yet", session=opened.id, reason=str(error))
                raise
            except Exception as error:  # whatever is wrong with it, the others go on
                self._forget(opened.id)
                known = isinstance(error, OracleError)
                reason = str(error) if known else f"{type(error).__name__}: {error}"
                self._unrestored[opened.id] = unrestored = Unrestored(opened, reason)
                self._history.trouble(opened.number, unrestored.trouble)
                log.error("a session can't be restored", session=opened.id, reason=reason, exc_info=not known)

    async def _close(self, recorded: SessionRecord) -> None:
        """Close the session of a recording; until that is committed, it is known as one that is not judged."""
        name, now = recorded.id, self._clock.now()
        state = await cut_off(recorded, self._history, now)
        self._unrestored[name] = Unrestored(recorded, CUT_OFF, state)
        self._history.close_session(recorded.number, now, state, lambda: self._unrestored.pop(name, None))
        log.warning("a recording was judged in part only", session=name)

    def _forget(self, name: str) -> None:
        failed = self._open.pop(name, None)
        if failed is not None:
            failed.ledger.snapshots.end()
