"""Nodes that are on the graph and that DDS does not connect to the monitor: nothing says so but the adapter."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.robot import spec_folder
from tests.ros2.harness import Scene, eventually

unmatched = pytest.importorskip("oracle_ros2.unmatched")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

SPEC = """
id: x
streams:
  - {topic: /x, type: std_msgs/msg/Int64}
  - {topic: /cmd, type: std_msgs/msg/Int64, action: filter}
properties:
  - {id: small, formula: 'not {topic: /x, data > 3}', guards: [/cmd]}
"""
PROFILES = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com"><profiles>
  <publisher profile_name="/x"><qos><partition><names><name>robot1</name></names></partition></qos></publisher>
  <subscriber profile_name="/cmd"><qos><partition><names><name>robot1</name></names></partition></qos></subscriber>
</profiles></dds>
"""
DRIVER = """
import rclpy, std_msgs.msg as msg
rclpy.init()
node = rclpy.create_node("driver")
publisher = node.create_publisher(msg.Int64, "/x", 10)
node.create_subscription(msg.Int64, "/cmd", print, 10)
node.create_timer(0.1, lambda: publisher.publish(msg.Int64(data=5)))
rclpy.spin(node)
"""


def test_who_is_in_another_partition_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    profiles = tmp_path / "profiles.xml"
    profiles.write_text(PROFILES, encoding="utf-8")
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        adapter = scene.adapter("x")
        with monkeypatch.context() as set_for_the_driver:
            set_for_the_driver.setenv("FASTDDS_DEFAULT_PROFILES_FILE", str(profiles))
            driver = scene.run("driver", sys.executable, "-c", DRIVER)
        adapter.said(f"/x: /driver publishes /x, and nothing of it is heard: {unmatched.WHY}")
        adapter.said(f"/cmd: /driver subscribes to /cmd, and gets nothing of it: {unmatched.WHY}")

        def troubles() -> dict[str, str]:
            [monitor] = scene.server.session("s")["monitors"]
            return {stream["stream"]: stream["trouble"] for stream in monitor["streams"]}

        eventually(troubles, lambda told: "/driver publishes /x, and nothing of it is heard" in told["/x"])
        driver.remove()
        eventually(troubles, lambda told: "/driver" not in "".join(told.values()))
        adapter.ends_well()


def test_who_has_just_come_is_not_told_nor_where_counts_are_not() -> None:
    now = [0.0]
    found = unmatched.Unmatched("publishes /x, and nothing of it is heard", lambda: now[0])

    def look(at: float, nodes: list[str], connected: int | None) -> str:
        now[0] = at
        return str(found.look(nodes, connected))

    assert look(0.0, ["/b", "/a"], 1) == ""
    assert look(4.9, ["/b", "/a"], 1) == ""
    assert look(5.0, ["/b", "/a"], 1) == f"1 of /a, /b publishes /x, and nothing of it is heard: {unmatched.WHY}"
    assert look(6.0, ["/b", "/a"], 2) == ""
    assert look(7.0, ["/a"], 0) == ""
    assert look(12.0, ["/a"], 0) == f"/a publishes /x, and nothing of it is heard: {unmatched.WHY}"
    assert look(13.0, ["/a"], None) == ""
