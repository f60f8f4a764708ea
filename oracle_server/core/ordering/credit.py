"""Back-pressure: how many events each monitor may send before the order has made progress."""

from __future__ import annotations

from typing import Any

from oracle_server.core.ordering.reorder import ReorderBuffer

_FEW = 8
"""As many monitors share the pool at first."""


class Credit:
    """Gives each monitor a share of a quarter of the order's capacity, and refills it as it is used.

    Above half of the capacity a monitor that is ahead of the order gets no more. A monitor with a stream that the order
    waits for always does, since what it sends next may end the wait. So monitors that respect their credit keep the
    order below its capacity and never all wait for each other; events of others may exceed it.
    """

    def __init__(self, capacity: int) -> None:
        """Share the room of an order of `capacity` events."""
        self._high, self._pool = capacity // 2, capacity // 4
        self._first = max(1, self._pool // _FEW)
        self.left: dict[str, int] = {}
        """How many more events each monitor may send; below zero where it sent more."""
        self._wanting: set[str] = set()
        self._barred: set[str] = set()
        """Those of them that were ahead of the order when they were last looked at."""
        self._seen = 0
        """The order's changes up to then."""

    @property
    def share(self) -> int:
        """What one monitor may send at a time."""
        return max(1, self._pool // max(1, len(self.left)))

    def open(self, monitor: str) -> int:
        """Reset a monitor; returns how many events it may send at first."""
        self.left[monitor] = self._first
        self._forget(monitor)
        return self._first

    def close(self, monitor: str) -> None:
        """Remove a monitor."""
        self.left.pop(monitor, None)
        self._forget(monitor)

    def spend(self, monitor: str) -> None:
        """Count an event that a monitor has sent."""
        left = self.left.get(monitor)
        if left is not None:
            self.left[monitor] = left - 1
            if left <= self._first // 2 + 1:
                self._wanting.add(monitor)

    def grant(self, buffer: ReorderBuffer[Any]) -> list[tuple[str, int]]:
        """How many events more each monitor may send now; those that get none are left out."""
        if not self._wanting and not self._barred:
            return []
        if len(buffer) <= self._high:
            able = self._wanting | self._barred
            self._barred.clear()
        else:
            able = self._able(buffer)
        self._wanting.clear()
        return [(monitor, self._fill(monitor)) for monitor in sorted(able)]

    def _able(self, buffer: ReorderBuffer[Any]) -> set[str]:
        """Those that want more and are not ahead; who was ahead is looked at again only where that may have changed."""
        wanting = self._wanting
        if self._barred and self._seen != buffer.changes:
            wanting = wanting | (self._barred & buffer.behind)
        self._seen = buffer.changes
        able = {monitor for monitor in wanting if not buffer.is_ahead(monitor)}
        self._barred = (self._barred - able) | (wanting - able) if able else self._barred | wanting
        return able

    def _forget(self, monitor: str) -> None:
        self._wanting.discard(monitor)
        self._barred.discard(monitor)

    def _fill(self, monitor: str) -> int:
        more = max(1, self.share - self.left[monitor])
        self.left[monitor] += more
        return more
