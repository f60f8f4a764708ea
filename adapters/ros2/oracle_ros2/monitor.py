"""The monitor node: it observes, filters and proxies what the server names, and sends its streams' clocks."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

from oracle_adapter import Attention, graph_name
from oracle_adapter.clocks import SIMULATED, Clocks, SilentClock, TornClock, wall_doubt
from oracle_adapter.command import check_names
from oracle_adapter.interfaces import interfaces_of, report_unknown
from oracle_adapter.monitors import NAME, VERDICT
from rclpy.clock import Clock, ClockType

from oracle_ros2.alone import GRAPH, Alone
from oracle_ros2.endpoints import full_name
from oracle_ros2.graph import namesakes
from oracle_ros2.parts import make_part, names_on_graph
from oracle_ros2.shared import Shared
from oracle_ros2.stamps import on_back, simulated, time_of

if TYPE_CHECKING:
    from oracle_adapter import Attached, Board, Link, Names
    from rclpy.node import Node

CLOCK_PERIOD = 0.01
LOOK_PERIOD = 0.5
SHOW_PERIOD = 0.1
BY_CLOCK = "start the adapter with --ros-args -p use_sim_time:=true"
"""How to run by simulated time."""


class Monitor:
    """Everything that one node observes for one link."""

    def __init__(self, node: Node, link: Link, board: Board, names: Names, attached: Attached) -> None:
        """Observe the streams that the server named.

        Raises `CodecError` where a type is not there, ValueError where a remapped stream isn't, two have one name, one
        and its proxy have, or ROS does not let one be observed.
        """
        check_names(names, attached, partial(names_on_graph, node))
        self._node, self._link, self._board = node, link, board
        self._attached, self._streams = attached, attached.streams
        self._verdict = f"{graph_name(attached.monitor)}/{VERDICT}"
        streams = attached.streams
        self._now, self._attention = time_of(node), Attention()
        self._alone = Alone(node)
        self._clocks = clocks = Clocks(self._now)
        self._watch, self._silent, self._torn = None, SilentClock(self._now), TornClock()
        if simulated(node):
            self._watch = on_back(node, self._renew)
        shared = Shared(node, link, board, names, clocks, attached.limits.get("max_frame"))
        self._parts = [make_part(shared, interface) for interface in interfaces_of(streams)]
        observed = [stream for part in self._parts for stream in part.streams]
        clocks.follow(observed)
        board.keep(stream["name"] for stream in streams)
        report_unknown(streams, board, link)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # simulated time may be paused
        self._timers = [
            node.create_timer(LOOK_PERIOD, self._look, clock=steady),
            node.create_timer(CLOCK_PERIOD, self._send_clocks, clock=steady),
            node.create_timer(SHOW_PERIOD, lambda: board.tick(link.stats()), clock=steady),
        ]
        for stream in observed:
            link.report(stream.name, stream.kind, time_source=stream.time_source)
        node.get_logger().info(f"observing {len(streams)} streams for session {attached.session}")

    @property
    def outdated(self) -> bool:
        """Whether the server wants other streams by now, as where the session was made again from a changed spec."""
        attached = self._link.attached
        if attached is None or attached is self._attached:  # the usual case, read at each message
            return False
        self._attached = attached
        return attached.streams != self._streams

    def stop(self) -> None:
        """Take nothing more, and send no more clocks; what is decided later is not forwarded."""
        if self._watch is not None:
            self._watch.unregister()
        for timer in self._timers:
            self._node.destroy_timer(timer)
        for part in self._parts:
            part.stop()

    def _look(self) -> None:
        tellers = [full_name(info) for info in self._node.get_publishers_info_by_topic("/clock")]
        time_doubt = wall_doubt(tellers, BY_CLOCK) if self._watch is None else ""
        time_trouble = self._silent.look() or self._torn.look(tellers)
        standing = "" if self._watch is None else self._silent.doubt
        self._board.trouble(SIMULATED, time_trouble, time_doubt or standing)
        self._board.trouble(NAME, "", namesakes(self._node, self._verdict))
        alone = self._alone.look()
        self._board.trouble(GRAPH, "", alone)
        for part in self._parts:
            trouble, first = part.look(), part.streams[0]
            self._board.trouble(first.name, trouble, part.doubt)
            by_field = any(stream.time_source == "field" for stream in part.streams)
            once = (alone, standing) if part is self._parts[0] else ()
            trouble = "; ".join(filter(None, (trouble, part.doubt, *once, time_doubt if by_field else "")))
            self._link.report(first.name, first.kind, trouble=trouble, bypass=part.bypass)

    def _renew(self) -> None:
        """Go on in another session, as simulated time goes back."""
        self._torn.goes_back()
        self._link.renew(self._clocks.gone_back)

    def _send_clocks(self) -> None:
        """Send how far each stream has come: exactly where messages are stamped here, else less a delay.

        What has come by then is taken first: while this thread is delayed, messages wait for it, and so must clocks.
        Where the middleware may be in a stall, no clocks are sent for the streams of other nodes.
        """
        received_by: int | None = self._now()
        for part in self._parts:
            part.catch_up()
        if not self._attention.is_paid(time.monotonic(), sum(part.received for part in self._parts)):
            received_by = None
        self._link.clock(lambda: self._clocks.readings(received_by))
