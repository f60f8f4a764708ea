"""The monitor: what the oracle wants observed, filtered and proxied, and the clocks of its streams."""

from __future__ import annotations

import itertools
from typing import Any, List, Mapping, Sequence, Union

from oracle_adapter import ClockStamp, Link

from oracle_ros1.services import ProxiedService
from oracle_ros1.stamps import Now
from oracle_ros1.topics import FilteredTopic, LoggedTopic

CLOCK_PERIOD = 0.01
"""Seconds between two turns."""
LOOK_EVERY = 5  # turns


class Monitor:
    """Everything that one node observes for one link."""

    def __init__(self, link: Link, streams: Sequence[Mapping[str, Any]], now: Now) -> None:
        """Observe the streams that the server named. Raises `CodecError` where a type is not there."""
        self._link, self._now = link, now
        by_key = {(s["name"], s["kind"]): s for s in streams}
        self._services = [
            ProxiedService(link, s, by_key[s["name"], "response"], now) for s in streams if s["kind"] == "request"
        ]
        self._topics: List[Union[FilteredTopic, LoggedTopic]] = [
            (FilteredTopic if s["action"] == "filter" else LoggedTopic)(link, s, now)
            for s in streams
            if s["kind"] == "topic"
        ]
        self._turns = itertools.count()

    def turn(self) -> None:
        """Tell the clocks and, now and then, look at the topics' publishers; to be called every `CLOCK_PERIOD`."""
        if next(self._turns) % LOOK_EVERY == 0:
            for topic in self._topics:
                topic.look()
        self._link.clock(self._stamps)

    def stop(self) -> None:
        """Take nothing more."""
        for service in self._services:
            service.stop()
        for topic in self._topics:
            topic.stop()

    def _stamps(self) -> List[ClockStamp]:
        """How far each stream has come: exactly where its events are stamped here, else less its latency."""
        now = self._now()
        if now is None:
            return []
        sides = [side for service in self._services for side in service.sides]
        return [
            *((side.name, side.kind, now if side.stamp is None else max(0, now - side.latency)) for side in sides),
            *((topic.observed.name, "topic", self._spoken_for(topic, now)) for topic in self._topics),
        ]

    def _spoken_for(self, topic: Union[FilteredTopic, LoggedTopic], now: int) -> int:
        stamped_here = topic.observed.time_source == "arrival"
        return now if stamped_here else max(0, now - topic.observed.latency)
