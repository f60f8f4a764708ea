"""How long a session goes on whose own trace is judged in another order: until its last deadline, in that order too."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.kinds import TICK
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.session import Session
from oracle_server.core.spec import Ordering
from oracle_server.core.verdicts import Judged
from oracle_server.replay.recording import Recorded


class LastDeadline:
    """The last deadline that a trace tells of, and until when (ns) a session in another order goes on for it.

    A tick tells that its own time has passed, and no more where its session ran in a simulation: it was judged at a
    time of the server's. By publication a deadline is judged once `max_delay` is over. In the other order the same
    deadline may be later: by arrival by as much as events came after their stamps, by publication by as much as their
    stamps were ahead.
    """

    def __init__(self, ordering: Ordering) -> None:
        """Begin without any; `ordering` is that in which the trace is judged now."""
        self.until = 0
        self._ordering = ordering
        self._ahead = self._behind = 0
        self._last = 0

    def note(self, recorded: Recorded) -> None:
        """Take an event or a tick of the trace."""
        event, longest = recorded.event, self._ordering.max_delay
        if event.stream.kind != TICK:
            ahead = 0 if event.stamp is None else event.stamp - event.arrived
            self._ahead = max(self._ahead, min(ahead, self._ordering.max_skew))
            self._behind = max(self._behind, -ahead if longest is None else min(-ahead, longest))
            return
        by_arrival = {place.order for place in recorded.places} == {"arrival"}
        time, until = event.stamp or 0, 0
        if self._ordering.by != "publication":
            until = max(time + 1, min(event.arrived, time + (0 if by_arrival else self._behind) + 1))
        if self._ordering.by != "arrival":
            time += self._ahead if by_arrival else 0
            until = max(until, time + (longest or 0) + 1)
        self._last, self.until = max(self._last, time), max(self.until, until)

    def settle(self, session: Session) -> Iterator[list[Judged]]:
        """Judge it by publication at the end, where it waits for what is held, or for ever: nothing older will come."""
        if self._last:
            for monitor, stream in session.buffer.frontiers:
                yield session.clock(monitor, [ClockReading(stream, self._last + 1)], session.now)
