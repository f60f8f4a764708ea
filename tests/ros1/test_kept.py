"""What a latching publisher has kept since before an adapter began stands where it came."""

from __future__ import annotations

import time
from pathlib import Path

from genpy import Time
from std_msgs.msg import Header

from tests.processes import eventually
from tests.robot import spec_folder
from tests.ros1.harness import Scene

SPEC = """
id: maps
streams:
  - {topic: /map, type: std_msgs/Header}
  - {topic: /scan, type: std_msgs/Header}
properties: [{id: some, formula: 'once {topic: "/map"}'}]
"""
HOUR = 3_600 * 10**9


def header(stamp: int) -> Header:
    return Header(stamp=Time(*divmod(stamp, 10**9)))


def test_what_was_kept_stands_where_it_came_and_all_else_by_its_stamp(tmp_path: Path) -> None:
    """By its stamp all that nobody heard yet would be missing in that hour."""
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        peer, long_ago = scene.peer(), time.time_ns() - HOUR
        peer.advertise(Header, "/map", listeners=0, latch=True)
        peer.publish("/map", header(long_ago))
        started = time.time_ns()
        scene.adapter("maps")

        def stamps(stream: str, count: int) -> list[int]:
            found = eventually(lambda: scene.server.events("s", stream=stream), lambda events: len(events) == count)
            return [event["stamp"] for event in found]

        assert stamps("/map", 1)[0] > started
        now = time.time_ns()
        peer.publish("/map", header(now))
        assert stamps("/map", 2)[1] == now
        peer.advertise(Header, "/scan")
        peer.publish("/scan", header(long_ago))
        assert stamps("/scan", 1) == [long_ago]
