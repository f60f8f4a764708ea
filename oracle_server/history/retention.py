"""What need not be kept any longer: closed sessions first, the oldest of them first, then the oldest of open ones.

What an open session would be restored from is never taken away: all until it is saved, and then what came since.
"""

from __future__ import annotations

import asyncio
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.core.spec import Retention
from oracle_server.history.port import History
from oracle_server.history.records import Extent

_CHUNK = 2_000
"""Rows that are deleted with one commit, so that none waits long for it."""
_WORTH_A_SNAPSHOT = 10

_Older = Mapping[tuple[int, int], int]
"""How many steps of a session (by its number) are older than an age (ns)."""

log = structlog.get_logger()


@dataclass(slots=True)
class _Kept:
    """One session, and how much of it is to go."""

    extent: Extent
    cut: int = 0
    """How many of its oldest events go; of one that goes as a whole, all and one more."""

    @property
    def is_open(self) -> bool:
        return self.extent.closed is None

    @property
    def size(self) -> int:
        return self.extent.last - self.extent.first + 1

    @property
    def left(self) -> int:
        return max(0, self.size - self.cut)

    def make_room(self, count: int) -> int:
        """Let so many more of its oldest events go, or as many as may; how many those are."""
        free = self.size
        if self.is_open:
            free = min(self.extent.settled, self.extent.last - 1) - self.extent.first + 1
        more = max(0, min(count, free - self.cut))
        self.cut += more
        return more


class Pruner:
    """Keeps one server's history within its bounds and those of its specs."""

    def __init__(
        self,
        history: History,
        bounds: Retention,
        of_specs: Callable[[], dict[str, Retention]],
        now: Callable[[], int],
        save: Callable[[int], None],
    ) -> None:
        """Prune by the server's `bounds`, and those `of_specs` by their ids; `now` is in nanoseconds.

        `save` saves an open session, by its number, so that less is needed to restore it.
        """
        self._history, self._bounds, self._of_specs, self._now, self._save = history, bounds, of_specs, now, save

    async def run(self, every: float) -> None:
        """Look every so many seconds, for ever: what fails is logged, and tried again the next time."""
        while True:
            await asyncio.sleep(every)
            if self._history.failure is not None:
                continue
            try:
                await self.prune()
            except HistoryError as error:
                log.error("the history can't be pruned now", reason=str(error))
            except Exception:  # whatever it is: without this task the disk would fill up, and nobody would know
                log.exception("the history can't be pruned now")

    async def prune(self) -> None:
        """Delete what is beyond the bounds, and have sessions saved of which more should go than may."""
        sessions = [_Kept(extent) for extent in await self._history.extents()]
        size, bounds = await self._history.size(), self._of_specs()
        older = await self._older(sessions, {b.age for b in (*bounds.values(), self._bounds) if b.age is not None})
        for number in await asyncio.to_thread(self._choose_all, sessions, size, bounds, older):
            self._save(number)
        for session in sessions:
            if session.cut:
                await self._delete(session)

    async def _older(self, sessions: list[_Kept], ages: set[int]) -> _Older:
        now = self._now()
        return {
            (session.extent.number, age): await self._history.judged_before(session.extent, now - age)
            for session in sessions
            if session.is_open
            for age in ages
        }

    def _choose_all(self, sessions: list[_Kept], size: int, bounds: dict[str, Retention], older: _Older) -> set[int]:
        """Mark what goes; the numbers of the open sessions that are to be saved. It takes long for many sessions."""
        row_size = size / max(1, sum(session.size for session in sessions))
        groups = defaultdict(list)
        for session in sessions:
            groups[session.extent.spec].append(session)
        wanted: set[int] = set()
        for spec, group in groups.items():
            wanted |= self._choose(bounds.get(spec, Retention()), group, row_size, older)
        return wanted | self._choose(self._bounds, sessions, row_size, older)

    def _choose(self, bounds: Retention, group: list[_Kept], row_size: float, older: _Older) -> set[int]:
        """Let go what is beyond some bounds; the open sessions of which that may not go yet."""
        closed = [s for s in group if not s.is_open]
        live = [s for s in group if s.is_open]
        wanted: set[int] = set()
        if bounds.age is not None:
            oldest = self._now() - bounds.age
            for session in closed:
                if (session.extent.closed or 0) < oldest:
                    session.cut = session.size + 1
            wanted |= _cut((session, older[session.extent.number, bounds.age] - session.cut) for session in live)
        for limit in (bounds.events, None if bounds.size is None else int(bounds.size / row_size)):
            excess = 0 if limit is None else sum(s.left for s in group) - limit
            for session in closed:
                if excess > 0 and session.left:
                    excess -= session.make_room(excess)
                    session.cut += session.left == 0
            level = _level([s.left for s in live], excess)
            wanted |= _cut((session, session.left - level) for session in live)
        return wanted

    async def _delete(self, session: _Kept) -> None:
        extent, count = session.extent, session.cut
        for start in range(extent.first, extent.first + min(count, session.size), _CHUNK):
            await self._history.forget_steps(extent.number, min(start + _CHUNK, extent.first + count))
        if count > session.size:
            await self._history.forget_session(extent.number)
        log.info("history deleted", session=extent.number, events=min(count, session.size))


def _cut(sessions: Iterable[tuple[_Kept, int]]) -> set[int]:
    """Let so many events of open sessions go; the numbers of those to save, where a tenth of the rest could go then."""
    wanted = set()
    for session, count in sessions:
        missing = count - session.make_room(count)
        if missing > session.left // _WORTH_A_SNAPSHOT and session.extent.settled < session.extent.last - 1:
            wanted.add(session.extent.number)
    return wanted


def _level(sizes: list[int], excess: int) -> int:
    """The most that each may keep so that together they make as much room as is needed: the largest ones make it."""
    if excess <= 0:
        return max(sizes, default=0)
    levels = range(max(sizes, default=0) + 1)
    return max(0, bisect_right(levels, -excess, key=lambda level: -sum(max(0, size - level) for size in sizes)) - 1)
