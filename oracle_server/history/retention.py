"""Deletes history beyond the limits: closed sessions first, the oldest before others, then old events of open ones.

Where there are too many bytes, those sessions of them go first that have no events. Events that are needed to restore
an open session are never deleted: all without a snapshot, else those after it. What a robot has open is the robot's: it
is not deleted at a centre, and counts for none of the limits.
"""

from __future__ import annotations

import asyncio
import math
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.core.spec import Retention
from oracle_server.history.port import History
from oracle_server.history.records import Extent, Free

_CHUNK = 2_000
"""Rows that are deleted with one commit, so that other commits are not delayed."""
_AT_ONCE = 64
"""Sessions without events that are forgotten together: each one by itself would take a commit a table."""
_REFUSED = 1_000
"""Refused events that an open session keeps of many."""
_WORTH_A_SNAPSHOT = 10
"""A snapshot is taken to make room only if more than one in so many of the remaining events could then go."""

_Older = Mapping[tuple[int, int], int]
"""How many steps of a session (by its number) are older than an age (ns)."""

log = structlog.get_logger()


@dataclass(slots=True)
class _Candidate:
    """One session, and how much of it is to be deleted."""

    extent: Extent
    cut: int = 0
    """How many of its oldest events are deleted; one more than all to delete the session itself."""

    @property
    def is_open(self) -> bool:
        return self.extent.closed is None

    @property
    def size(self) -> int:
        return self.extent.last - self.extent.first + 1

    @property
    def left(self) -> int:
        return max(0, self.size - self.cut)

    @property
    def is_gone(self) -> bool:
        return self.cut > self.size

    def make_room(self, count: int) -> int:
        """Mark up to `count` more of its oldest events for deletion; returns how many could be marked."""
        free = self.size
        if self.is_open:
            free = min(self.extent.settled, self.extent.last - 1) - self.extent.first + 1
        more = max(0, min(count, free - self.cut))
        self.cut += more
        return more


class _Measure(NamedTuple):
    """What there may be at the `most`, and how much of that a step is; `in_bytes`, what is beside steps counts too."""

    most: float
    step: float
    in_bytes: bool

    def of(self, session: _Candidate) -> float:
        beside = session.extent.beside if self.in_bytes and not session.is_gone else 0
        return session.left * self.step + beside

    def steps(self, excess: float) -> int:
        return math.ceil(excess / self.step)

    def sequence(self, closed: list[_Candidate]) -> list[_Candidate]:
        """Closed sessions as they make room. Those without events make none but in bytes, and then before others."""
        return sorted(closed, key=lambda session: self.in_bytes and session.left > 0)


class Hold(NamedTuple):
    """What is not forwarded yet is held back: `free` tells what is, and `most` is the size from which on this ends."""

    free: Callable[[], Awaitable[Sequence[Free]]]
    most: int


class Pruner:
    """Keeps one server's history within the server's limits and those of its specs."""

    def __init__(
        self,
        history: History,
        bounds: Retention,
        of_specs: Callable[[], dict[str, Retention]],
        ago: Callable[[int], int],
        save: Callable[[int], None],
        hold: Hold | None = None,
    ) -> None:
        """Prune by the server's `bounds`, and those `of_specs` by the specs' ids.

        `ago` tells what time it was so many nanoseconds ago.
        `save` takes a snapshot of an open session, by its number, so that earlier events can be deleted.
        What is not forwarded yet is deleted as `hold` says.
        """
        self._history, self._bounds, self._of_specs, self._ago, self._save = history, bounds, of_specs, ago, save
        self._hold = hold

    async def run(self, every: float) -> None:
        """Prune every so many seconds, for ever; failures are logged, and tried again the next time."""
        while True:
            await asyncio.sleep(every)
            if self._history.failure is not None:
                continue
            try:
                await self.prune()
            except HistoryError as error:
                log.error("the history can't be pruned now", reason=str(error))
            except Exception:  # without this task, the disk would fill up unnoticed
                log.exception("the history can't be pruned now")

    async def prune(self) -> None:
        """Delete what is beyond the limits, and take snapshots of sessions that could then be cut further."""
        bounds = self._of_specs()
        if all(each == Retention() for each in (*bounds.values(), self._bounds)):
            return
        tended = await self._history.tended()
        extents = await self._history.extents()
        if await self._delete_refused(extents, bounds, tended):
            extents = await self._history.extents()
        sessions = [_Candidate(extent) for extent in extents]
        size = await self._history.size()
        older = await self._older(sessions, {b.age for b in (*bounds.values(), self._bounds) if b.age is not None})
        for number in await asyncio.to_thread(self._choose_all, sessions, size, bounds, older):
            self._save(number)
        if self._hold is not None:
            _hold_back(sessions, await self._free(self._hold), size > self._hold.most)
        cut = [s for s in sessions if s.cut and (tended is None or s.extent.number in tended)]
        empty = [session for session in cut if not session.size]
        for start in range(0, len(empty), _AT_ONCE):
            await asyncio.gather(*map(self._delete, empty[start : start + _AT_ONCE]))
        for session in cut:
            if session.size:
                await self._delete(session)

    async def _older(self, sessions: list[_Candidate], ages: set[int]) -> _Older:
        return {
            (session.extent.number, age): await self._history.judged_before(session.extent, self._ago(age))
            for session in sessions
            if session.is_open and not session.extent.held
            for age in ages
        }

    def _choose_all(
        self, sessions: list[_Candidate], size: int, bounds: dict[str, Retention], older: _Older
    ) -> set[int]:
        """Mark what to delete; returns the numbers of open sessions to save. With many sessions this takes long."""
        beside = sum(session.extent.beside for session in sessions)
        row_size = max(1.0, (size - beside) / max(1, sum(session.size for session in sessions)))
        tended = [session for session in sessions if not session.extent.held]
        groups = defaultdict(list)
        for session in tended:
            groups[session.extent.spec].append(session)
        wanted: set[int] = set()
        for spec, group in groups.items():
            wanted |= self._choose(bounds.get(spec, Retention()), group, row_size, older)
        return wanted | self._choose(self._bounds, tended, row_size, older)

    def _choose(self, bounds: Retention, group: list[_Candidate], row_size: float, older: _Older) -> set[int]:
        """Mark what is beyond some limits; returns the numbers of open sessions that a snapshot would make smaller."""
        closed = [s for s in group if not s.is_open]
        live = [s for s in group if s.is_open]
        wanted: set[int] = set()
        if bounds.age is not None:
            oldest = self._ago(bounds.age)
            for session in closed:
                if (session.extent.closed or 0) < oldest:
                    session.cut = session.size + 1
            wanted |= _cut((session, older[session.extent.number, bounds.age] - session.cut) for session in live)
        for measure in _measures(bounds, row_size):
            excess = sum(map(measure.of, group)) - measure.most
            for session in measure.sequence(closed):
                if excess > 0 and not session.is_gone:
                    before = measure.of(session)
                    session.make_room(measure.steps(excess))
                    session.cut += session.left == 0
                    excess -= before - measure.of(session)
            level = _level([s.left for s in live], measure.steps(excess))
            wanted |= _cut((session, session.left - level) for session in live)
        return wanted

    async def _delete_refused(
        self, extents: list[Extent], bounds: dict[str, Retention], tended: frozenset[int] | None
    ) -> bool:
        """Keep the last refused events alone of open sessions that have twice as many, before what was judged goes.

        Returns whether there were any such sessions.
        """
        many = [
            extent
            for extent in extents
            if extent.closed is None
            and not extent.held
            and extent.refused >= 2 * _REFUSED
            and (tended is None or extent.number in tended)
            and any(each != Retention() for each in (self._bounds, bounds.get(extent.spec, Retention())))
        ]
        if many and self._hold is not None and await self._history.size() <= self._hold.most:
            free = await self._free(self._hold)
            many = [extent for extent in many if _is_free(extent, free.get(extent.number))]
        for extent in many:
            needed = await self._history.forget_refused(extent.number, _REFUSED)
            if needed >= _REFUSED:
                self._save(extent.number)
                await self._history.flush()
                needed = await self._history.forget_refused(extent.number, _REFUSED)
            log.info("history deleted", refused=extent.refused - _REFUSED - needed, session=extent.number)
        return bool(many)

    async def _free(self, hold: Hold) -> Mapping[int, Free]:
        return {free.session: free for free in await hold.free()}

    async def _delete(self, session: _Candidate) -> None:
        extent, count = session.extent, session.cut
        for start in range(extent.first, extent.first + min(count, session.size), _CHUNK):
            await self._history.forget_steps(extent.number, min(start + _CHUNK, extent.first + count))
        if count > session.size:
            await self._history.forget_session(extent.number)
        log.info("history deleted", session=extent.number, events=min(count, session.size))


def _measures(bounds: Retention, row_size: float) -> list[_Measure]:
    measures = [] if bounds.events is None else [_Measure(bounds.events, 1, in_bytes=False)]
    return measures if bounds.size is None else [*measures, _Measure(bounds.size, row_size, in_bytes=True)]


def _is_free(extent: Extent, known: Free | None) -> bool:
    """Whether all that is kept of a session is forwarded."""
    return known is not None and not known.more and known.position >= extent.last


def _hold_back(sessions: Iterable[_Candidate], free: Mapping[int, Free], full: bool) -> None:
    """Have no session deleted that is not forwarded, nor steps of it; of a `full` history all steps but the last."""
    for session in sessions:
        extent, known = session.extent, free.get(session.extent.number)
        upto = 0 if known is None else known.position - extent.first + 1
        if not session.cut or _is_free(extent, known):
            continue
        if not full:
            session.cut = max(0, min(session.cut, upto))
            continue
        session.cut = max(0, min(session.cut, session.size - 1))
        lost = session.cut - max(0, upto)
        if lost > 0:
            log.error(
                "steps are deleted that are not forwarded yet, or whose episodes are not: the history has the size up "
                "to which they are held",
                session=extent.number, steps=lost,
            )  # fmt: skip


def _cut(sessions: Iterable[tuple[_Candidate, int]]) -> set[int]:
    """Mark so many events of open sessions; returns the numbers of sessions to save, so that more can be deleted."""
    wanted = set()
    for session, count in sessions:
        missing = count - session.make_room(count)
        if missing > session.left // _WORTH_A_SNAPSHOT and session.extent.settled < session.extent.last - 1:
            wanted.add(session.extent.number)
    return wanted


def _level(sizes: list[int], excess: int) -> int:
    """The most events that each session may keep so that `excess` are deleted in all, from the largest sessions."""
    if excess <= 0:
        return max(sizes, default=0)
    levels = range(max(sizes, default=0) + 1)
    return max(0, bisect_right(levels, -excess, key=lambda level: -sum(max(0, size - level) for size in sizes)) - 1)
