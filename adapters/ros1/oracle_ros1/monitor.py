"""The monitor: what the oracle wants observed, filtered and proxied, and the clocks of its streams."""

from __future__ import annotations

import itertools
from typing import Any, List, Mapping, Sequence, Union

from oracle_adapter import Board, ClockStamp, Link, Names

from oracle_ros1.graph import Graph
from oracle_ros1.services import ProxiedService
from oracle_ros1.stamps import Now
from oracle_ros1.topics import FilteredTopic, LoggedTopic

CLOCK_PERIOD = 0.01
"""Seconds between two turns."""
LOOK_EVERY = 5
"""Turns between two looks at the publishers, and two of the diagnostics."""


class Monitor:
    """Everything that one node observes for one link."""

    def __init__(self, link: Link, board: Board, names: Names, streams: Sequence[Mapping[str, Any]], now: Now) -> None:
        """Observe the streams that the server named. Raises `CodecError` where a type is not there."""
        self._link, self._board, self._now = link, board, now
        by_key = {(s["name"], s["kind"]): s for s in streams}
        self._services = [
            ProxiedService(link, board, names, s, by_key[s["name"], "response"], now)
            for s in streams
            if s["kind"] == "request"
        ]
        self._sides = [side for service in self._services for side in service.sides]
        self._graph = Graph()
        self._topics: List[Union[FilteredTopic, LoggedTopic]] = [
            FilteredTopic(link, board, names, s, now, self._graph)
            if s["action"] == "filter"
            else LoggedTopic(link, board, names, s, now)
            for s in streams
            if s["kind"] == "topic"
        ]
        self._graph.start()
        self._turns = itertools.count()

    def turn(self) -> None:
        """Tell the clocks and, now and then, how the streams are; to be called every `CLOCK_PERIOD`."""
        if next(self._turns) % LOOK_EVERY == 0:
            self._look()
        self._link.clock(self._stamps)

    def stop(self) -> None:
        """Take nothing more."""
        self._graph.stop()
        for service in self._services:
            service.stop()
        for topic in self._topics:
            topic.stop()

    def renew(self) -> None:
        """Go on in another session: simulated time went back."""
        self._link.renew(self._stamps)

    def _look(self) -> None:
        """Tell how the streams are."""
        for topic in self._topics:
            trouble, name = topic.look(), topic.observed.name
            self._board.trouble(name, trouble)
            self._link.report(name, "topic", time_source=topic.observed.time_source, trouble=trouble)
        for side in self._sides:
            self._link.report(side.name, side.kind, time_source="field" if side.stamp else "arrival")
        self._board.tick(self._link.stats())

    def _stamps(self) -> List[ClockStamp]:
        """How far each stream has come: exactly where its events are stamped here, else less its latency."""
        now = self._now()
        if now is None:
            return []
        return [
            *(
                (side.name, side.kind, now if side.stamp is None else max(0, now - side.latency))
                for side in self._sides
            ),
            *((topic.observed.name, "topic", self._spoken_for(topic, now)) for topic in self._topics),
        ]

    def _spoken_for(self, topic: Union[FilteredTopic, LoggedTopic], now: int) -> int:
        stamped_here = topic.observed.time_source == "arrival"
        return now if stamped_here else max(0, now - topic.observed.latency)
