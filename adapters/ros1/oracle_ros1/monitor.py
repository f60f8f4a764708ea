"""The monitor: it observes, filters and proxies what the server names, and sends its streams' clocks."""

from __future__ import annotations

import itertools
from typing import List, Optional

import rospy
from oracle_adapter import Attached, Board, ClockStamp, Link, Names, graph_name
from oracle_adapter.clocks import SIMULATED, Clocks, SilentClock, TornClock, wall_doubt
from oracle_adapter.command import check_names
from oracle_adapter.interfaces import interfaces_of, report_unknown
from oracle_adapter.monitors import NAME, VERDICT, namesakes_text

from oracle_ros1.graph import Graph
from oracle_ros1.headers import headers, node_of
from oracle_ros1.observed import deafen
from oracle_ros1.parts import Part, make_part, names_on_graph
from oracle_ros1.shared import Shared
from oracle_ros1.stamps import on_back, simulated_now, wall_now

CLOCK_PERIOD = 0.01
"""Seconds between two turns."""
LOOK_EVERY = 5
"""Turns between two looks at the publishers, and two of the diagnostics."""
MASTER = "ROS master"
"""What the board calls the master; no stream can have a name with a blank."""
BY_CLOCK = "set the parameter /use_sim_time to true, and start the adapter again"
"""How to run by simulated time."""


class Monitor:
    """Everything that one node observes for one link."""

    def __init__(self, link: Link, board: Board, names: Names, attached: Attached, *, simulated: bool) -> None:
        """Observe the streams that the server named.

        Raises `CodecError` where a type is not there, ValueError where a remapped stream isn't, or where two
        have one name, or one and its proxy.
        """
        check_names(names, attached, names_on_graph)
        self._link, self._board, self._streams = link, board, attached.streams
        self._now = now = simulated_now if simulated else wall_now
        self._graph = Graph()
        self._verdict = rospy.resolve_name(f"{graph_name(attached.monitor)}/{VERDICT}")
        self._clocks, self._silent = Clocks(now), SilentClock(now)
        self._torn = TornClock()
        frame = attached.limits.get("max_frame")
        shared = Shared(link, board, names, now, self._graph, self._clocks, frame)
        self._parts: List[Part] = []
        self._jumps: Optional[rospy.Subscriber] = None
        try:
            for interface in interfaces_of(attached.streams):
                self._parts.append(make_part(shared, interface))
            if simulated:
                self._jumps = on_back(self._renew)
        except BaseException:  # the parts that are there would forward on, by policy where the link has ended
            self.stop()
            raise
        self._clocks.follow(stream for part in self._parts for stream in part.streams)
        board.keep(stream["name"] for stream in attached.streams)
        report_unknown(attached.streams, board, link)
        self._graph.start()
        self._turns = itertools.count()
        rospy.loginfo(f"observing {len(attached.streams)} streams for session {attached.session}")

    @property
    def outdated(self) -> bool:
        """Whether the server wants other streams by now, as where the session was made again from a changed spec."""
        attached = self._link.attached
        return attached is not None and attached.streams != self._streams

    def turn(self) -> None:
        """Send the clocks and, every `LOOK_EVERY` turns, the streams' state; to be called every `CLOCK_PERIOD`."""
        if next(self._turns) % LOOK_EVERY == 0:
            self._look()
        self._link.clock(self._stamps)

    def stop(self) -> None:
        """Take nothing more, and forward nothing more: what waits is reported as not passed."""
        self._graph.stop()
        if self._jumps is not None:
            deafen(self._jumps)
        for part in self._parts:
            part.stop()

    def leave(self) -> None:
        """Unregister all at the master, which may hang, after `stop`."""
        self._graph.leave()
        if self._jumps is not None:
            self._jumps.unregister()
        for part in self._parts:
            part.leave()

    def _look(self) -> None:
        """Report the streams' state."""
        time_doubt, silence = self._look_at_time(), self._graph.silence
        standing = "" if self._jumps is None else self._silent.doubt
        self._board.trouble(MASTER, silence)
        self._board.trouble(NAME, "", namesakes_text(self._graph.publishers(self._verdict), self._verdict))
        for part in self._parts:
            trouble, first = part.look(), part.streams[0]
            self._board.trouble(first.name, trouble, part.doubt)
            by_field = any(stream.time_source == "field" for stream in part.streams)
            once = standing if part is self._parts[0] else ""
            trouble = "; ".join(filter(None, (silence, trouble, part.doubt, once, time_doubt if by_field else "")))
            self._link.report(first.name, first.kind, trouble=trouble, bypass=part.bypass)
            for stream in part.streams:
                self._link.report(stream.name, stream.kind, time_source=stream.time_source)
        self._board.tick(self._link.stats())

    def _look_at_time(self) -> str:
        """Show what is wrong with the time; what may be wrong with stamps of others, empty for nothing."""
        if self._jumps is None:
            doubt = wall_doubt(self._graph.publishers(rospy.resolve_name("/clock")), BY_CLOCK)
            self._board.trouble(SIMULATED, "", doubt)
            return doubt
        tellers = {node_of(header) for header in headers(self._jumps)}
        trouble = self._silent.look() or self._torn.look(sorted(tellers))
        self._board.trouble(SIMULATED, trouble, self._silent.doubt)
        return ""

    def _renew(self) -> None:
        """Go on in another session, as simulated time goes back."""
        self._torn.goes_back()
        self._link.renew(self._clocks.gone_back)

    def _stamps(self) -> List[ClockStamp]:
        return self._clocks.readings(self._now())
