"""Events as they come: their signals, and when they were published."""

from __future__ import annotations

from collections import defaultdict

import msgspec

from oracle_server.core.boot import BootClock
from oracle_server.core.events import Event, Step
from oracle_server.core.plan import Plan
from oracle_server.core.simulated import SimulatedTime
from oracle_server.core.stamps import Stamp, since_boot_in, stamp_in


class Arriving:
    """Makes steps of a session's events."""

    def __init__(self, plan: Plan) -> None:
        self.simulated: SimulatedTime | None = None
        """The time of the simulation that the session runs in; None where its time is the server's."""
        self._plan = plan
        self._boots: defaultdict[str, BootClock] = defaultdict(lambda: BootClock(plan.spec.ordering.max_skew))

    def step(self, event: Event) -> Step:
        """The step of an event that has come."""
        stream = self._plan.streams[event.stream]
        signals, failed = stream.project(event.data)
        stamp = self._stamp(event, stream.spec.stamp)
        if self.simulated is not None:
            event = msgspec.structs.replace(event, arrived=self.simulated.arrival(stamp), received=event.arrived)
        stamp = stamp or event.arrived
        skewed = stamp - event.arrived > self._plan.spec.ordering.max_skew
        return Step(event, signals, failed, stamp, skewed)

    def _stamp(self, event: Event, where: Stamp | None) -> int | None:
        """An event's publication time (ns): what the monitor said, or what the server reads of the message itself."""
        if where is None or where.plain:
            return event.stamp or stamp_in(event.data, where)
        if where.epoch == "unix":
            return stamp_in(event.data, where) or event.stamp
        since_boot = since_boot_in(event.data, where)
        if since_boot is None:
            return event.stamp
        known = event.stamp or (self.simulated and self.simulated.now) or event.arrived
        return self._boots[event.monitor].place((event.stream, event.source), since_boot, known)
