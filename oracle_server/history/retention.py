"""What need not be kept any longer: closed sessions first, the oldest of them first, then the oldest of open ones.

What an open session would be restored from is never taken away: all until it is saved, and then what came since.
"""

from __future__ import annotations

import asyncio
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import structlog

from oracle_server.core.spec import Retention
from oracle_server.history.sqlite.store import Store
from oracle_server.process.clock import Clock
from oracle_server.specfiles.library import Library

_CHUNK = 2_000
"""Rows that are deleted with one commit, so that none waits long for it."""
_WORTH_A_SNAPSHOT = 10
_OF_A_SESSION = (("refused", "session"), ("monitors", "session"), ("snapshots", "session"), ("sessions", "number"))
"""The tables besides `steps` that have rows of a session, and their columns with its number; itself at last."""

log = structlog.get_logger()


@dataclass(slots=True)
class _Kept:
    """One session: its events from position `first` to `last` are in the history; `closed` (ns) is None while open.

    Of an open one, those up to `settled` are not needed to restore it.
    """

    number: int
    spec: str
    closed: int | None
    settled: int
    first: int
    last: int
    cut: int = 0
    """How many of its oldest events go; of one that goes as a whole, all and one more."""

    @property
    def size(self) -> int:
        return self.last - self.first + 1

    @property
    def left(self) -> int:
        return max(0, self.size - self.cut)

    def make_room(self, count: int) -> int:
        """Let so many more of its oldest events go, or as many as may; how many those are."""
        free = self.size if self.closed is not None else min(self.settled, self.last - 1) - self.first + 1
        more = max(0, min(count, free - self.cut))
        self.cut += more
        return more


class Pruner:
    """Keeps one server's history within its bounds and those of its specs."""

    def __init__(
        self, store: Store, library: Library, clock: Clock, bounds: Retention, save: Callable[[int], None]
    ) -> None:
        """`save` saves an open session, by its number, so that less is needed to restore it."""
        self._store, self._library, self._clock, self._bounds, self._save = store, library, clock, bounds, save

    async def run(self, every: float) -> None:
        """Look every so many seconds, for ever."""
        while True:
            await asyncio.sleep(every)
            if self._store.failure is None:
                await self.prune()

    async def prune(self) -> None:
        """Delete what is beyond the bounds, and have sessions saved of which more should go than may."""
        bounds = {spec: self._bounds_of(spec) for spec in self._library.ids()}
        going, wanted = await asyncio.to_thread(self._choose_all, bounds)
        for number in wanted:
            self._save(number)
        for session in going:
            await self._delete(session)

    def _choose_all(self, bounds: dict[str, Retention]) -> tuple[list[_Kept], set[int]]:
        """The sessions of which something goes, and the numbers of those that are to be saved."""
        sessions, row_size = self._look()
        groups = defaultdict(list)
        for session in sessions:
            groups[session.spec].append(session)
        wanted: set[int] = set()
        for spec, group in groups.items():
            wanted |= self._choose(bounds.get(spec, Retention()), group, row_size)
        wanted |= self._choose(self._bounds, sessions, row_size)
        return [session for session in sessions if session.cut], wanted

    def _look(self) -> tuple[list[_Kept], float]:
        """All sessions, the oldest first, and how many bytes an event takes."""
        rows = self._store.read(
            "SELECT s.number, s.spec, s.closed, coalesce(saved.settled, 0) "
            "FROM sessions s LEFT JOIN snapshots saved ON saved.session = s.number ORDER BY s.number"
        )
        span = "SELECT min(position), max(position) FROM steps WHERE session = ?"
        sessions = []
        for number, spec, closed, settled in rows:
            first, last = self._store.read(span, (number,))[0]
            sessions.append(_Kept(number, spec, closed, settled, first or 1, last or 0))
        used = self._store.read(
            "SELECT (p.page_count - f.freelist_count) * s.page_size FROM pragma_page_count p, "
            "pragma_freelist_count f, pragma_page_size s"
        )
        return sessions, used[0][0] / max(1, sum(s.size for s in sessions))

    def _bounds_of(self, spec: str) -> Retention:
        return self._library.last(spec).plan.spec.retention

    def _choose(self, bounds: Retention, group: list[_Kept], row_size: float) -> set[int]:
        """Let go what is beyond some bounds; the open sessions of which that may not go yet."""
        closed = [s for s in group if s.closed is not None]
        live = [s for s in group if s.closed is None]
        wanted: set[int] = set()
        if bounds.age is not None:
            oldest = self._clock.now() - bounds.age
            for session in closed:
                if (session.closed or 0) < oldest:
                    session.cut = session.size + 1
            wanted |= _cut((session, self._older(session, oldest) - session.cut) for session in live)
        for limit in (bounds.events, None if bounds.size is None else int(bounds.size / row_size)):
            excess = 0 if limit is None else sum(s.left for s in group) - limit
            for session in closed:
                if excess > 0 and session.left:
                    excess -= session.make_room(excess)
                    session.cut += session.left == 0
            level = _level([s.left for s in live], excess)
            wanted |= _cut((session, session.left - level) for session in live)
        return wanted

    def _older(self, session: _Kept, time: int) -> int:
        """How many of a session's events were judged before a time (ns)."""
        sql = "SELECT judged FROM steps WHERE session = ? AND position = ?"
        positions = range(session.first, session.last + 1)
        return bisect_left(positions, time, key=lambda p: self._store.read(sql, (session.number, p))[0][0])

    async def _delete(self, session: _Kept) -> None:
        count = session.cut
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


def _cut(sessions: Iterable[tuple[_Kept, int]]) -> set[int]:
    """Let so many events of open sessions go; the numbers of those to save, where a tenth of the rest could go then."""
    wanted = set()
    for session, count in sessions:
        missing = count - session.make_room(count)
        if missing > session.left // _WORTH_A_SNAPSHOT and session.settled < session.last - 1:
            wanted.add(session.number)
    return wanted


def _level(sizes: list[int], excess: int) -> int:
    """The most that each may keep so that together they make as much room as is needed: the largest ones make it."""
    if excess <= 0:
        return max(sizes, default=0)
    levels = range(max(sizes, default=0) + 1)
    return max(0, bisect_right(levels, -excess, key=lambda level: -sum(max(0, size - level) for size in sizes)) - 1)
