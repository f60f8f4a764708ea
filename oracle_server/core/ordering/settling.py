"""Up to when deadlines have waited long enough for the events that meet them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.ordering.reorder import ReorderBuffer
from oracle_server.core.ordering.returning import Returning
from oracle_server.core.ordering.simulated import SimulatedTime
from oracle_server.core.spec import Ordering, StreamSpec

NEVER = 2**63


class Settling:
    """Deadlines wait `max_delay` of the server's time, and for monitors that come back after a restart."""

    def __init__(self, ordering: Ordering, buffer: ReorderBuffer[Any]) -> None:
        self.returning = Returning()
        """Monitors that were attached before a restart."""
        self._wait = None if ordering.max_delay is None else max(1, ordering.max_delay)
        self._max_skew = ordering.max_skew
        self._buffer, self._revises = buffer, ordering.late == "revise"

    def simulated(self, streams: Mapping[StreamKey, StreamSpec], now: int | None) -> SimulatedTime:
        """A simulation's time, of which is known as much as deadlines depend on; `now` as of before a restart (ns)."""
        return SimulatedTime(streams, 2 * (self._wait or 0), self._max_skew, now)

    def until(self, order: Order, now: int, simulated: SimulatedTime | None) -> int | None:
        """Up to when (ns) deadlines are settled, None where it is not known; `now` is the server's time.

        Behind what is held, and was in time, they wait for as long again.
        """
        if order == "arrival":
            present = now if simulated is None else simulated.now
            return None if present is None else present - 1
        since, wait = self.returning.since, self._wait
        if wait is None or since is None or now - wait < since:
            return None
        told, held = self.returning.told(now), self._held_since(order)
        past = self._at(now, wait, told, simulated)
        if past is None or held > past:
            return past
        before = self._at(now, 2 * wait, told, simulated) if now - 2 * wait >= since else None
        return held - 1 if before is None else max(held - 1, before)

    def due(self, order: Order, deadline: int, now: int, simulated: SimulatedTime | None) -> int | None:
        """When, by the server's time (ns), a deadline is settled, None where time alone does not do that."""
        reached = deadline if simulated is None else simulated.reached(deadline + 1)
        if order == "arrival":
            return deadline + 1 if simulated is None else reached
        since, wait = self.returning.since, self._wait
        if wait is None or since is None or reached is None:
            return None
        waits = wait if deadline < self._held_since(order) else 2 * wait
        told = self.returning.told(now)
        due = max(reached, since) + waits
        return due if told is None or deadline <= told - waits else max(due, self.returning.until(now))

    @staticmethod
    def _at(now: int, ago: int, told: int | None, simulated: SimulatedTime | None) -> int | None:
        """The session's time (ns) as it was a while ago; of what is only told now, as far before that.

        A simulation's goes by in steps, and at each of them more may happen.
        """
        then = now - ago + 1 if simulated is None else simulated.at(now - ago)
        return None if then is None else min(then - 1, then if told is None else told - ago)

    def _held_since(self, order: Order) -> int:
        """The time of the oldest event held: deadlines of it wait for that, unless it can be put in its place."""
        first = self._buffer.first if order == "publication" and not self._revises else None
        return NEVER if first is None else first
