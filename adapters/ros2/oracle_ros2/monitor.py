"""The monitor node: what the oracle wants observed, filtered and proxied, and the clocks of its streams."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, Mapping, Sequence

from oracle_ros2.services import ProxiedService
from oracle_ros2.topics import FilteredTopic, LoggedTopic

if TYPE_CHECKING:
    from oracle_adapter import ClockStamp, Link
    from rclpy.node import Node

CLOCK_PERIOD = 0.01
REMATCH_PERIOD = 0.5


class Monitor:
    """Everything that one node observes for one link."""

    def __init__(self, node: Node, link: Link, streams: Sequence[Mapping[str, Any]]) -> None:
        """Observe the streams that the server named. Raises `CodecError` where a type is not there."""
        self._link = link
        self._latencies = {(s["name"], s["kind"]): s["latency"] if s["kind"] == "topic" else 0 for s in streams}
        by_key = {(s["name"], s["kind"]): s for s in streams}
        self._topics = [
            (FilteredTopic if s["action"] == "filter" else LoggedTopic)(node, link, s)
            for s in streams
            if s["kind"] == "topic"
        ]
        self._services = [
            ProxiedService(node, link, s, by_key[s["name"], "response"]) for s in streams if s["kind"] == "request"
        ]
        node.create_timer(REMATCH_PERIOD, self._rematch)
        self._stopping = threading.Event()
        self._clock = threading.Thread(target=self._tell_time, name="stream clocks", daemon=True)
        self._clock.start()

    def stop(self) -> None:
        """Tell no more clocks."""
        self._stopping.set()
        self._clock.join()

    def _rematch(self) -> None:
        for topic in self._topics:
            topic.matched.rematch()

    def _tell_time(self) -> None:
        """Say how far each stream has come: exactly for services, which are stamped here, less a delay for topics."""
        while not self._stopping.wait(CLOCK_PERIOD):
            self._link.clock(self._readings)

    def _readings(self) -> list[ClockStamp]:
        now = time.time_ns()
        return [(name, kind, now - latency) for (name, kind), latency in self._latencies.items()]
