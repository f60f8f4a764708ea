"""The open sessions as they go on, for Foxglove: what the history has committed, never sooner, and never waited for."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from contextlib import aclosing
from functools import partial

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.foxglove.listening import Listening, Offered
from oracle_server.foxglove.session import Drawing
from oracle_server.history.port import Reading
from oracle_server.history.readers import reading_for
from oracle_server.history.records import StoredStep
from oracle_server.sessions.beginnings import Beginnings
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.registry import Registry

MOST = 100
"""Sessions that are offered at once, the oldest ones: a client is told of all channels when it connects."""
_READER = "foxglove"
"""As whom it reads the history: as one of its clients, which take turns."""
_LOOK = 0.5
"""Seconds between two looks for sessions that were opened."""
_GATHER = 0.05
"""Seconds between two reads of a session's history."""
_RECALLED = 1_000
"""Steps before the last one from which it begins: how properties stand, and which signals there are."""
_BEHIND = 10_000
"""Steps that it may be behind; beyond them it goes on from the last ones."""

log = structlog.get_logger()


class Live:
    """Offers the open sessions on a port, each from when it is opened or restored until it is closed."""

    def __init__(self, listening: Listening, registry: Registry, history: Reading, allowed: Callable[[], bool]) -> None:
        """Begin with none; it goes on for as long as it is `allowed`."""
        self._listening, self._registry, self._history, self._allowed = listening, registry, history, allowed
        self._tasks: dict[int, asyncio.Task[None]] = {}
        self._given_up: set[int] = set()

    async def run(self) -> None:
        """Offer sessions until this is cancelled, or not allowed any more."""
        loop = asyncio.get_running_loop()
        self._listening.subscribed = lambda offered: _call(loop, offered)
        try:
            while self._allowed():
                self._look()
                self._listening.catch_up()
                await asyncio.sleep(_LOOK)
            log.error("there are tokens now, and Foxglove has none: nothing is offered to it any more")
        finally:
            for task in self._tasks.values():
                task.cancel()
            await asyncio.gather(*self._tasks.values(), return_exceptions=True)
            await asyncio.to_thread(self._listening.close)

    def _look(self) -> None:
        """Begin with the sessions that were opened since the last look."""
        self._tasks = {number: task for number, task in self._tasks.items() if not task.done()}
        for session in self._registry.open.values():
            known = session.number in self._tasks or session.number in self._given_up
            if len(self._tasks) < MOST and not known and not session.ledger.commits.ended:
                with reading_for(_READER):
                    self._tasks[session.number] = asyncio.create_task(self._draw(session))

    async def _draw(self, session: LiveSession) -> None:
        drawing = Drawing(session.id, session.record.properties, tuple(session.core.judges), self._listening)
        try:
            await self._follow(session, drawing)
        except HistoryError as error:
            log.warning("a session can't be read for Foxglove", session=session.id, reason=str(error))
        except Exception:
            log.exception("a session can't be drawn for Foxglove", session=session.id)
            self._given_up.add(session.number)
        finally:
            drawing.end()

    async def _follow(self, session: LiveSession, drawing: Drawing) -> None:
        commits, number, episodes = session.ledger.commits, session.number, Beginnings(session, self._history)
        first, last = await self._history.extent(number)
        position = max(first - 1, last - _RECALLED)
        while True:
            upcoming, ended = commits.next(), commits.ended
            while page := await self._page(number, position):
                await self._history.in_thread(partial(drawing.take, page))
                position = page[-1].position
                _, last = await self._history.extent(number)
                if last - position > _BEHIND:
                    skipped = last - _RECALLED - position
                    self._registry.counters.undrawn += skipped
                    log.warning("Foxglove is shown the newest steps only", session=session.id, skipped=skipped)
                    position += skipped
            told = await episodes.news()
            await self._history.in_thread(partial(drawing.tell, told, session.clock.now()))
            if ended:
                return
            await asyncio.wait((upcoming,))
            await asyncio.sleep(_GATHER)

    async def _page(self, number: int, position: int) -> Sequence[StoredStep]:
        async with aclosing(self._history.steps(number, position)) as pages:
            return await anext(pages, [])


def _call(loop: asyncio.AbstractEventLoop, offered: Offered) -> None:
    """Repeat a channel's last message, from another thread."""
    with contextlib.suppress(RuntimeError):  # the loop has ended
        loop.call_soon_threadsafe(offered.repeat)
