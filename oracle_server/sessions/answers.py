"""What a monitor is answered about an event that it sends again, once that is committed: what the history has of it."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.core.verdicts import decision_frame
from oracle_server.history.port import Reading
from oracle_server.sessions.monitor import Monitor, Outbox

_MOST = 1_000
"""Events that may wait for their answers; beyond, the session's monitors are not read until there is room."""

log = structlog.get_logger()


class Answers:
    """Looks decisions up, one after the other, and sends each to the connection that wanted it."""

    def __init__(self, history: Reading, session: int, properties: Sequence[str]) -> None:
        """Answer for the session of a number, whose properties have these ids."""
        self._history, self._session, self._properties = history, session, properties
        self._wanted: deque[tuple[Monitor, Outbox, int]] = deque()
        self._room = asyncio.Event()
        self._room.set()
        self._task: asyncio.Task[None] | None = None

    @property
    def has_room(self) -> bool:
        """Whether no more than `_MOST` events wait for their answers."""
        return self._room.is_set()

    async def room(self) -> None:
        """Wait until there is room."""
        await self._room.wait()

    def want(self, monitor: Monitor, outbox: Outbox, seq: int) -> None:
        """Answer a monitor about its event of a number as soon as the history has been read, then acknowledge it."""
        self._wanted.append((monitor, outbox, seq))
        monitor.unsettled += 1
        if len(self._wanted) > _MOST:
            self._room.clear()
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._run())

    async def _run(self) -> None:
        try:
            while self._wanted:
                monitor, outbox, seq = self._wanted.popleft()
                if len(self._wanted) <= _MOST:
                    self._room.set()
                if monitor.outbox is outbox:
                    await self._answer(monitor, outbox, seq)
                monitor.unsettled -= 1
                monitor.let_go()
        finally:
            self._task = None

    async def _answer(self, monitor: Monitor, outbox: Outbox, seq: int) -> None:
        problem = "an event that was sent again can't be answered"  # it goes on without an answer, as its spec says
        try:
            step = await self._history.asked_step(self._session, monitor.name, seq)
            if step is not None and step.decision is not None:
                verdicts = dict(zip(self._properties, step.outcomes, strict=True))
                outbox.send(decision_frame(seq, step.decision, verdicts))
        except HistoryError as error:
            log.error(problem, monitor=monitor.name, seq=seq, reason=str(error))
        except Exception:  # whatever it is: those behind it would wait for ever
            log.exception(problem, monitor=monitor.name, seq=seq)
        else:
            monitor.acknowledge()
