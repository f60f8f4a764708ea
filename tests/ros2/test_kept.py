"""What was kept since before an adapter began, for who comes later, stands where it came."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from tests.robot import spec_folder
from tests.ros2.harness import Scene, eventually

rclpy_qos = pytest.importorskip("rclpy.qos")
msg = pytest.importorskip("std_msgs.msg")
times = pytest.importorskip("builtin_interfaces.msg")

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

SPEC = """
id: maps
streams:
  - {topic: /map, type: std_msgs/msg/Header}
  - {topic: /mode, type: std_msgs/msg/Int64}
  - {topic: /scan, type: std_msgs/msg/Header}
properties: [{id: some, formula: 'once {topic: "/map"}'}]
"""
HOUR = 3_600 * 10**9
LASTING = rclpy_qos.QoSProfile(depth=1, durability=rclpy_qos.DurabilityPolicy.TRANSIENT_LOCAL)


def header(stamp: int) -> Any:
    seconds, rest = divmod(stamp, 10**9)
    return msg.Header(stamp=times.Time(sec=seconds, nanosec=rest))


def test_what_was_kept_stands_where_it_came_and_all_else_by_its_stamp(tmp_path: Path) -> None:
    """By its stamp all that nobody heard yet would be missing in that hour."""
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        peer, long_ago = scene.peer(), time.time_ns() - HOUR
        maps = peer.node.create_publisher(msg.Header, "/map", LASTING)
        modes = peer.node.create_publisher(msg.Int64, "/mode", LASTING)
        maps.publish(header(long_ago))
        modes.publish(msg.Int64(data=1))
        started = time.time_ns()
        scene.adapter("maps")

        def stamps(stream: str, count: int) -> list[int]:
            found = eventually(lambda: scene.server.events("s", stream=stream), lambda events: len(events) == count)
            return [event["stamp"] for event in found]

        peer.until(lambda: maps.get_subscription_count() and modes.get_subscription_count(), "nobody hears")
        assert stamps("/map", 1)[0] > started
        assert stamps("/mode", 1)[0] > started
        now = time.time_ns()
        maps.publish(header(now))
        assert stamps("/map", 2)[1] == now
        peer.publisher(msg.Header, "/scan").publish(header(long_ago))
        assert stamps("/scan", 1) == [long_ago]
