"""The monitor: what the oracle wants observed, filtered and proxied, and the clocks of its streams."""

from __future__ import annotations

import itertools
from typing import List, Union

import rospy
from oracle_adapter import Attached, Board, ClockStamp, Link, Names
from oracle_adapter.command import unknown_remap

from oracle_ros1.graph import Graph
from oracle_ros1.services import ProxiedService
from oracle_ros1.stamps import on_back, simulated_now, wall_now
from oracle_ros1.topics import FilteredTopic, LoggedTopic

CLOCK_PERIOD = 0.01
"""Seconds between two turns."""
LOOK_EVERY = 5
"""Turns between two looks at the publishers, and two of the diagnostics."""


class Monitor:
    """Everything that one node observes for one link."""

    def __init__(self, link: Link, board: Board, names: Names, attached: Attached, *, simulated: bool) -> None:
        """Observe the streams that the server named.

        Raises `CodecError` where a type is not there, ValueError where a remapped stream isn't.
        """
        unknown = unknown_remap(names, attached)
        if unknown:
            raise ValueError(f"--remap {unknown}: {attached.spec} has no such stream")
        self._link, self._board, self._streams = link, board, attached.streams
        self._now = now = simulated_now if simulated else wall_now
        streams = attached.streams
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
        self._jumps = on_back(lambda: link.renew(self._stamps)) if simulated else None
        rospy.loginfo(f"observing {len(streams)} streams for session {attached.session}")

    @property
    def outdated(self) -> bool:
        """Whether the oracle wants other streams by now: a session that was made anew has the spec of today."""
        attached = self._link.attached
        return attached is not None and attached.streams != self._streams

    def turn(self) -> None:
        """Tell the clocks and, now and then, how the streams are; to be called every `CLOCK_PERIOD`."""
        if next(self._turns) % LOOK_EVERY == 0:
            self._look()
        self._link.clock(self._stamps)

    def stop(self) -> None:
        """Take nothing more, and forward nothing more: what waits is not passed, and history is told so."""
        self._graph.stop()
        if self._jumps is not None:
            self._jumps.unregister()
        for service in self._services:
            service.stop()
        for topic in self._topics:
            topic.stop()

    def _look(self) -> None:
        """Tell how the streams are."""
        for topic in self._topics:
            trouble, name = topic.look(), topic.observed.name
            self._board.trouble(name, trouble)
            self._link.report(name, "topic", time_source=topic.observed.time_source, trouble=trouble)
        for service in self._services:
            trouble = self._graph.not_serving(service.proxy)
            self._board.trouble(service.name, trouble)
            self._link.report(service.name, "request", trouble=trouble)
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
