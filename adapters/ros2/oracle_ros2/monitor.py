"""The monitor node: what the oracle wants observed, filtered and proxied, and the clocks of its streams."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from oracle_adapter import Attention
from oracle_adapter.command import unknown_remap
from rclpy.clock import Clock, ClockType

from oracle_ros2.graph import past_proxy
from oracle_ros2.services import ProxiedService
from oracle_ros2.stamps import on_back, simulated, time_of
from oracle_ros2.topics import FilteredTopic, LoggedTopic

if TYPE_CHECKING:
    from oracle_adapter import Attached, Board, ClockStamp, Link, Names
    from rclpy.node import Node

CLOCK_PERIOD = 0.01
LOOK_PERIOD = 0.5
SHOW_PERIOD = 0.1


class Monitor:
    """Everything that one node observes for one link."""

    def __init__(self, node: Node, link: Link, board: Board, names: Names, attached: Attached) -> None:
        """Observe the streams that the server named.

        Raises `CodecError` where a type is not there, ValueError where a remapped stream isn't.
        """
        unknown = unknown_remap(names, attached)
        if unknown:
            raise ValueError(f"--remap {unknown}: {attached.spec} has no such stream")
        self._node, self._link, self._board = node, link, board
        self._attached, self._streams = attached, attached.streams
        streams = attached.streams
        self._now, self._attention = time_of(node), Attention()
        self._watch = None
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
        self._proxies = {s["name"]: (names[s["name"]], names[s["proxy"]]) for s in streams if s["kind"] == "request"}
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # simulated time may stand still
        self._timers = [
            node.create_timer(LOOK_PERIOD, self._look, clock=steady),
            node.create_timer(CLOCK_PERIOD, self._tell_time, clock=steady),
            node.create_timer(SHOW_PERIOD, lambda: board.tick(link.stats()), clock=steady),
        ]
        self._report()
        node.get_logger().info(f"observing {len(streams)} streams for session {attached.session}")

    @property
    def outdated(self) -> bool:
        """Whether the oracle wants other streams by now: a session that was made anew has the spec of today."""
        attached = self._link.attached
        if attached is None or attached is self._attached:  # asked for at each message, and nearly always so
            return False
        self._attached = attached
        return attached.streams != self._streams

    def stop(self) -> None:
        """Take nothing more, and tell no more clocks; what is decided yet is not forwarded any more."""
        if self._watch is not None:
            self._watch.unregister()
        for timer in self._timers:
            self._node.destroy_timer(timer)
        for part in (*self._topics, *self._services):
            part.stop()

    def _look(self) -> None:
        for topic in self._topics:
            self._tell_trouble(topic.name, "topic", topic.look())
        for name, (service, proxy) in self._proxies.items():
            self._tell_trouble(name, "request", past_proxy(self._node, service, proxy))

    def _tell_trouble(self, name: str, kind: str, trouble: str) -> None:
        self._board.trouble(name, trouble)
        self._link.report(name, kind, trouble=trouble)

    def _report(self) -> None:
        """Tell where the streams' times come from."""
        for topic in self._topics:
            self._link.report(topic.name, "topic", time_source=topic.time_source)
        for (name, kind), latency in self._latencies.items():
            if kind != "topic":
                self._link.report(name, kind, time_source="arrival" if latency is None else "field")

    def _tell_time(self) -> None:
        """Say how far each stream has come: exactly where messages are stamped here, else less a delay.

        What has come by then is taken first: while this thread is held up, messages wait for it, and time must too.
        Where the middleware may be held up, others are not spoken for.
        """
        heard: int | None = self._now()
        for topic in self._topics:
            topic.heard.take_all()
        for service in self._services:
            service.tend()
        if not self._attention.is_paid(time.monotonic(), sum(topic.observed.count for topic in self._topics)):
            heard = None
        self._link.clock(lambda: self._readings(heard))

    def _readings(self, heard: int | None) -> list[ClockStamp]:
        now = self._now()
        if not now:
            return []  # simulated time has not begun
        return [
            (name, kind, now if latency is None or heard is None else max(0, heard - latency))
            for (name, kind), latency in self._latencies.items()
            if latency is None or heard is not None
        ]
