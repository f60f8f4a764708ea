"""What need not be kept any longer: history of closed sessions, the oldest first.

What an open session would be restored from is never taken away.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import structlog

from oracle_server.clock import Clock
from oracle_server.core.spec import Retention
from oracle_server.library import Library
from oracle_server.store import Store

_CHUNK = 2_000
"""Rows that are deleted with one commit, so that none waits long for it."""
_OF_A_SESSION = (("refused", "session"), ("monitors", "session"), ("snapshots", "session"), ("sessions", "number"))
"""The tables besides `steps` that have rows of a session, and their columns with its number; itself at last."""

log = structlog.get_logger()


@dataclass(slots=True)
class _Kept:
    """One session: its events from position `first` to `last` are in the history; `closed` (ns) is None while open."""

    number: int
    spec: str
    closed: int | None
    first: int
    last: int

    @property
    def size(self) -> int:
        return self.last - self.first + 1


class Pruner:
    """Keeps one server's history within its bounds and those of its specs."""

    def __init__(self, store: Store, library: Library, clock: Clock, bounds: Retention) -> None:
        self._store, self._library, self._clock, self._bounds = store, library, clock, bounds

    async def run(self, every: float) -> None:
        """Look every so many seconds, for ever."""
        while True:
            await asyncio.sleep(every)
            if self._store.failure is None:
                await self.prune()

    async def prune(self) -> None:
        """Delete what is beyond the bounds."""
        sessions, row_size = await asyncio.to_thread(self._look)
        groups = defaultdict(list)
        for session in sessions:
            groups[session.spec].append(session)
        cut: dict[int, int] = {}
        for spec, group in groups.items():
            self._choose(self._bounds_of(spec), group, row_size, cut)
        self._choose(self._bounds, sessions, row_size, cut)
        for session in sessions:
            if session.number in cut:
                await self._delete(session, cut[session.number])

    def _look(self) -> tuple[list[_Kept], float]:
        """All sessions, the oldest first, and how many bytes an event takes."""
        rows = self._store.read("SELECT number, spec, closed FROM sessions ORDER BY number")
        span = "SELECT min(position), max(position) FROM steps WHERE session = ?"
        sessions = []
        for number, spec, closed in rows:
            first, last = self._store.read(span, (number,))[0]
            sessions.append(_Kept(number, spec, closed, first or 1, last or 0))
        used = self._store.read(
            "SELECT (p.page_count - f.freelist_count) * s.page_size FROM pragma_page_count p, "
            "pragma_freelist_count f, pragma_page_size s"
        )
        return sessions, used[0][0] / max(1, sum(s.size for s in sessions))

    def _bounds_of(self, spec: str) -> Retention:
        return self._library.last(spec).plan.spec.retention if spec in self._library.ids() else Retention()

    def _choose(self, bounds: Retention, group: Iterable[_Kept], row_size: float, cut: dict[int, int]) -> None:
        """Note, by session, how many of its oldest events go; for a session that goes as a whole, all and one more."""
        closed = [s for s in group if s.closed is not None]
        if bounds.age is not None:
            oldest = self._clock.now() - bounds.age
            cut.update({s.number: s.size + 1 for s in closed if (s.closed or 0) < oldest})
        limits = [bounds.events, None if bounds.size is None else int(bounds.size / row_size)]
        for limit in limits:
            excess = 0 if limit is None else sum(max(0, s.size - cut.get(s.number, 0)) for s in group) - limit
            for session in closed:
                gone = cut.get(session.number, 0)
                more = min(excess, max(0, session.size - gone))
                if more > 0:
                    excess -= more
                    cut[session.number] = gone + more + (gone + more == session.size)

    async def _delete(self, session: _Kept, count: int) -> None:
        for start in range(session.first, session.first + min(count, session.size), _CHUNK):
            end = min(start + _CHUNK, session.first + count)
            await self._do("DELETE FROM steps WHERE session = ? AND position < ?", (session.number, end))
        if count > session.size:
            for table, key in _OF_A_SESSION:
                await self._do(f"DELETE FROM {table} WHERE {key} = ?", (session.number,))  # noqa: S608
        log.info("history deleted", session=session.number, events=min(count, session.size))

    async def _do(self, sql: str, values: tuple[int, ...]) -> None:
        done = asyncio.Event()
        self._store.execute(sql, values, done.set)
        await done.wait()
