"""Monitors that come back after a restart of the server, each with what it kept meanwhile."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from oracle_server.core.ordering.least import Least
from oracle_server.core.spec import SECOND

SILENT = SECOND
"""After how long (ns) without a word a monitor has nothing more to send."""
MOST = 60 * SECOND
"""How long (ns) a monitor that has come back may take to send what it kept; beyond, deadlines wait for it no longer."""


@dataclass(slots=True, eq=False)
class _Behind:
    """When it came back, and was heard last (ns); and the newest time that it told, None where it tells none."""

    number: int
    monitor: str
    came: int
    heard: int
    told: int | None = 0
    over: bool = False

    @property
    def until(self) -> int:
        """Until when deadlines wait for it (ns), where it says no more."""
        return min(self.heard + SILENT, self.came + MOST)


class Returning:
    """Since when all monitors are back, and how far those are that still send what they kept."""

    def __init__(self) -> None:
        """Wait for none."""
        self.since: int | None = 0
        """Since when all are back (ns of the server's time); None while some are awaited."""
        self._awaited: set[str] = set()
        self._behind: dict[str, _Behind] = {}
        self._told, self._until = Least(_told), Least(_until)
        self._numbers = itertools.count()

    def __bool__(self) -> bool:
        """Whether some may still send what they kept."""
        return bool(self._behind)

    def expect(self, monitor: str) -> None:
        """Wait for a monitor to come back."""
        self._awaited.add(monitor)
        self.since = None

    def came(self, monitor: str, now: int) -> None:
        """Note that a monitor is connected."""
        if monitor in self._awaited:
            self._forget(monitor)
            self._behind[monitor] = behind = _Behind(next(self._numbers), monitor, now, now)
            self._told.add(behind)
            self._until.add(behind)
            self._over(monitor, now)

    def left(self, monitor: str, now: int) -> None:
        """Wait for a monitor no more."""
        self._forget(monitor)
        self._over(monitor, now)

    def hear(self, monitor: str, time: int | None, now: int) -> None:
        """Note what a monitor says: how far it is (ns), None where it says something that has no time of its own."""
        known = self._behind.get(monitor)
        if known is None:
            return
        known.heard = max(known.heard, now)
        if time is not None:
            timed = known.told is not None
            known.told = max(known.told or 0, time)
            if not timed:
                self._told.add(known)
        elif known.told == 0:
            known.told = None

    def told(self, now: int) -> int | None:
        """The time that all have told (ns) who may still send what they kept; None where none may."""
        while (first := self._until.first()) is not None and first[0] <= now:
            self._forget(first[1].monitor)
        least = self._told.first()
        return None if least is None else least[0]

    def until(self, now: int) -> int:
        """When (ns) deadlines wait for one of them less, where none says any more."""
        first = self._until.first()
        return now if first is None else first[0]

    def _forget(self, monitor: str) -> None:
        known = self._behind.pop(monitor, None)
        if known is not None:
            known.over = True

    def _over(self, monitor: str, now: int) -> None:
        if monitor in self._awaited:
            self._awaited.remove(monitor)
            if not self._awaited:
                self.since = now


def _told(known: _Behind) -> int | None:
    return None if known.over else known.told


def _until(known: _Behind) -> int | None:
    return None if known.over else known.until
