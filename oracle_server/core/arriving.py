"""Events as they come: their signals, and when they were published."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from oracle_server.core.boot import PublicationTimes
from oracle_server.core.events import Event, Projected, Signals, Step
from oracle_server.core.ordering.simulated import SimulatedTime
from oracle_server.core.plan import Plan

_NOTHING: Signals = {}
_NONE = frozenset[str]()


class Arriving:
    """Makes steps of a session's events."""

    def __init__(self, plan: Plan) -> None:
        self.simulated: SimulatedTime | None = None
        """The time of the simulation that the session runs in; None where its time is the server's."""
        self._plan = plan
        self._revises = plan.spec.ordering.late == "revise"
        self._max_skew = plan.spec.ordering.max_skew
        self._published = PublicationTimes(self._max_skew)

    def step(self, event: Event) -> Step:
        """The step of an event that has come."""
        stream = self._plan.streams[event.stream]
        rows: Sequence[Projected] = stream.project.rows(event.data) if stream.spec.each else ()
        signals, failed = (_NOTHING, _NONE) if rows else stream.project(event.data)
        if event.goal_id is not None:
            signals = {**signals, **event.marks}
            rows = [({**row, **event.marks}, lacking) for row, lacking in rows]
        simulated = self.simulated
        if simulated is None:
            stamp = self._published.stamp(event, stream.spec.stamp, event.arrived)
        else:
            stamp = self._published.stamp(event, stream.spec.stamp, simulated.now if simulated.is_told else None)
            arrived = simulated.arrival(stamp, event.arrived)
            event = msgspec.structs.replace(event, arrived=arrived, received=event.arrived)
        stamp = stamp or event.arrived
        if self._revises:  # the step is kept for a horizon, and its message need not be
            event = msgspec.structs.replace(event, data=None)
        skewed = stamp - event.arrived > self._max_skew
        return Step(event, signals, failed, stamp, skewed, rows=tuple(rows))

    def clock(self, stamp: int, now: int) -> int:
        """What a clock says that arrives now (ns): that it is now, where it is ahead by more than `max_skew`."""
        return now if self.simulated is None and stamp - now > self._max_skew else stamp
