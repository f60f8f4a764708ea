"""What held events waited for: which streams were behind them, as the last ones, before their turn came."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from oracle_server.core.events import Source

MOST_TOLD = 8
"""The most streams that are told of one event."""
_MOST = 1_000
"""Ends of waits that are kept, while what was due by them is still held; beyond, what was waited for is not told."""


class _End(NamedTuple):
    """A wait that is over: nothing up to `reach` (ns) waits any more, of what had come by then.

    `behind` are the streams that had been waited for, each with the time before which it had nothing (None: unknown).
    """

    reach: int
    arrivals: int
    behind: tuple[tuple[Source, int | None], ...]


class Waits:
    """The ends of waits, by which held events are due. Costs nothing while nothing is held."""

    def __init__(self) -> None:
        self._ends: deque[_End] = deque()

    def __len__(self) -> int:
        return len(self._ends)

    def over(self, behind: Iterable[tuple[Source, int | None]], reach: int, arrivals: int, *, held: bool) -> None:
        """Streams have advanced, or are gone: nothing up to `reach` waits for any, as so many `arrivals` had come.

        `behind` are these streams, as they were before. A new stream or publisher may also lower `reach`: what is
        behind it waits anew.
        """
        if not held:
            return self._ends.clear()
        lowered = None
        while self._ends and self._ends[-1].reach > reach:
            lowered = self._ends.pop()
        if lowered is not None:
            self._ends.append(lowered._replace(reach=reach))
        told = tuple([(source, was) for source, was in behind if was is None or was < reach])
        if told and (not self._ends or self._ends[-1].reach < reach):
            if len(self._ends) == _MOST:
                self._ends.clear()
            self._ends.append(_End(reach, arrivals, told))
        return None

    def of(self, stamp: int, arrival: int) -> tuple[Source, ...]:
        """What an event waited for that is released now, older ones before it; nothing where it was due at once."""
        while self._ends and self._ends[0].reach < stamp:
            self._ends.popleft()
        if not self._ends or arrival > self._ends[0].arrivals:
            return ()
        found = (source for source, was in self._ends[0].behind if was is None or was < stamp)
        return tuple(sorted(found)[:MOST_TOLD])
