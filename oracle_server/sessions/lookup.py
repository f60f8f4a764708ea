"""Committed decisions, looked up in the history for monitors that send an event again."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

import structlog

from oracle_server.core.errors import HistoryError, UnansweredError
from oracle_server.core.verdicts import decision_frame
from oracle_server.history.port import Reading
from oracle_server.history.records import StoredStep
from oracle_server.sessions.monitor import Monitor, Outbox

_MOST = 1_000
"""Lookups that may wait; beyond this limit, the session's monitors are not read until there is room."""
_AGAIN = 0.2
"""Seconds until a database that did not answer is asked again."""

log = structlog.get_logger()


class DecisionLookup:
    """Reads decisions, one after the other, and sends each to the connection that requested it."""

    def __init__(self, history: Reading, session: int, properties: Sequence[str]) -> None:
        """Read for the session with this number, whose properties have these ids."""
        self._history, self._session, self._properties = history, session, properties
        self._requests: deque[tuple[Monitor, Outbox, int]] = deque()
        self._room = asyncio.Event()
        self._room.set()
        self._task: asyncio.Task[None] | None = None

    @property
    def has_room(self) -> bool:
        """Whether no more than `_MOST` lookups wait."""
        return self._room.is_set()

    async def room(self) -> None:
        """Wait until there is room."""
        await self._room.wait()

    def request(self, monitor: Monitor, outbox: Outbox, seq: int) -> None:
        """Send the decision on a monitor's event number `seq` once it has been read, then acknowledge the event."""
        self._requests.append((monitor, outbox, seq))
        monitor.unsettled += 1
        if len(self._requests) > _MOST:
            self._room.clear()
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._run())

    async def _run(self) -> None:
        try:
            while self._requests:
                monitor, outbox, seq = self._requests.popleft()
                if len(self._requests) <= _MOST:
                    self._room.set()
                if monitor.outbox is outbox:
                    await self._send(monitor, outbox, seq)
                monitor.unsettled -= 1
                monitor.confirm_detach()
        finally:
            self._task = None

    async def _send(self, monitor: Monitor, outbox: Outbox, seq: int) -> None:
        problem = "a decision can't be read again"  # the monitor then does what `on_unavailable` says
        try:
            step = await self._step(monitor, outbox, seq)
            if step is not None and step.decision is not None:
                verdicts = dict(zip(self._properties, step.outcomes, strict=True))
                outbox.send(decision_frame(seq, step.decision, verdicts))
        except HistoryError as error:
            log.error(problem, monitor=monitor.name, seq=seq, reason=str(error))
        except Exception:  # whatever it is: the requests behind it would wait for ever
            log.exception(problem, monitor=monitor.name, seq=seq)
        else:
            monitor.acknowledge()

    async def _step(self, monitor: Monitor, outbox: Outbox, seq: int) -> StoredStep | None:
        """The step in which an event was decided, as soon as the database answers, and while its monitor waits."""
        failing = False
        while True:
            try:
                return await self._history.asked_step(self._session, monitor.name, seq)
            except UnansweredError as error:
                if monitor.outbox is not outbox:
                    return None
                if not failing:
                    log.warning("a decision is not read again yet", monitor=monitor.name, seq=seq, reason=str(error))
                failing = True
            await asyncio.sleep(_AGAIN)
