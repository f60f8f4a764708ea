"""The monitor node: what the oracle wants observed, filtered and proxied, and the clocks of its streams."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Mapping, Sequence

from rclpy.clock import Clock, ClockType

from oracle_ros2.services import ProxiedService
from oracle_ros2.stamps import on_back, simulated, time_of
from oracle_ros2.topics import FilteredTopic, LoggedTopic

if TYPE_CHECKING:
    from oracle_adapter import Board, ClockStamp, Link, Names
    from rclpy.node import Node

CLOCK_PERIOD = 0.01
LOOK_PERIOD = 0.5
SHOW_PERIOD = 0.1


class Monitor:
    """Everything that one node observes for one link."""

    def __init__(
        self, node: Node, link: Link, board: Board, names: Names, streams: Sequence[Mapping[str, Any]]
    ) -> None:
        """Observe the streams that the server named. Raises `CodecError` where a type is not there."""
        self._link, self._board = link, board
        self._now = time_of(node)
        if simulated(node):
            self._watch = on_back(node, lambda: link.renew(lambda: self._readings(self._now())))
        # None: stamped here
        self._latencies = {
            (s["name"], s["kind"]): s["latency"] if s["kind"] == "topic" or s["stamp"] else None for s in streams
        }
        by_key = {(s["name"], s["kind"]): s for s in streams}
        self._topics = [
            FilteredTopic(node, link, board, names, s) if s["action"] == "filter" else LoggedTopic(node, link, names, s)
            for s in streams
            if s["kind"] == "topic"
        ]
        self._services = [
            ProxiedService(node, link, board, names, s, by_key[s["name"], "response"])
            for s in streams
            if s["kind"] == "request"
        ]
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # simulated time may stand still
        self._timers = [
            node.create_timer(LOOK_PERIOD, self._look, clock=steady),
            node.create_timer(CLOCK_PERIOD, self._tell_time, clock=steady),
            node.create_timer(SHOW_PERIOD, lambda: board.tick(link.stats()), clock=steady),
        ]

    def stop(self) -> None:
        """Tell no more clocks."""
        for timer in self._timers:
            timer.cancel()

    def _look(self) -> None:
        for topic in self._topics:
            self._board.trouble(topic.name, topic.look())

    def _tell_time(self) -> None:
        """Say how far each stream has come: exactly where messages are stamped here, else less a delay.

        What has come by then is taken first: while this thread is held up, messages wait for it, and time must too.
        """
        heard = self._now()
        for topic in self._topics:
            topic.heard.take_all()
        self._link.clock(lambda: self._readings(heard))

    def _readings(self, heard: int) -> list[ClockStamp]:
        now = self._now()
        if not now:
            return []  # simulated time has not begun
        return [
            (name, kind, now if latency is None else max(0, heard - latency))
            for (name, kind), latency in self._latencies.items()
        ]
