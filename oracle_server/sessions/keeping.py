"""Whether more of a session is taken: what is judged of it can be kept, and is not too much already."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

import structlog

from oracle_server.history.port import History
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.ledger import Ledger
from oracle_server.sessions.monitor import Monitor
from oracle_server.wire.errors import WireError

_MOST_UNKEPT = 20_000
"""Events that are taken of a session of which nothing more can be kept; beyond, its monitors are not read."""

log = structlog.get_logger()


class Keeping:
    """What keeps a session from being judged on, if anything does."""

    def __init__(
        self, record: SessionRecord, history: History, ledger: Ledger, monitors: Mapping[str, Monitor]
    ) -> None:
        self._id, self._number = record.id, record.number
        self._history, self._ledger, self._monitors = history, ledger, monitors
        self.failed: str | None = None
        """How judging failed; None where it has not. What the session then knows is that of no step."""

    @property
    def trouble(self) -> str | None:
        """Why nothing more of the session can be kept, so that it is not judged any more; None where it can."""
        return self.failed or self._history.failure_of(self._number)

    @property
    def failure(self) -> str | None:
        """Why no session can be kept at the moment, so that none is judged; None where they can."""
        return self._history.failure

    def check(self) -> None:
        """Raise a fatal `WireError` where nothing more of the session can be kept."""
        if self.trouble is not None:
            message = f"session '{self._id}' can't be kept any more: {self.trouble}; close it, and open another"
            raise WireError("history_unavailable", message, fatal=True)

    def fail(self, error: Exception) -> None:
        """Keep nothing from here on, since judging failed in a way that nobody foresaw, and drop all monitors.

        A row that followed would leave a gap behind what was judged and not told.
        """
        self.failed = f"judging it failed: {type(error).__name__}: {error}"
        log.error("a session can't be judged any more", session=self._id, exc_info=error)
        self._ledger.write()
        self._history.stop(self._number, self.failed)
        for monitor in self._monitors.values():
            if monitor.outbox is not None:
                monitor.outbox.drop(WireError("internal", "the server failed; see its log", fatal=True))

    @property
    def has_room(self) -> bool:
        """Whether the session accepts events; if not, its monitors are not read until it does."""
        return self._history.has_room and self._ledger.lookup.has_room and not self._is_crammed

    async def room(self) -> None:
        """Wait until the session accepts events, or is closed."""
        await self._history.room()
        await self._ledger.lookup.room()
        while self._is_crammed and not self._ledger.commits.ended:
            await asyncio.wait((self._ledger.commits.next(),))

    @property
    def _is_crammed(self) -> bool:
        """Whether nothing more can be kept, and as much waits for that as may."""
        return self.trouble is not None and sum(m.unsettled for m in self._monitors.values()) > _MOST_UNKEPT
