"""A topic that nobody publishes on real ROS 2, as where the spec misspells it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.robot import spec_folder
from tests.ros2.harness import Scene, eventually

msg = pytest.importorskip("std_msgs.msg")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

MISSPELT = """
id: misspelt
streams:
  - topic: /estops
    type: std_msgs/msg/Bool
    signals: {pressed: msg.data}
properties:
  - {id: never_pressed, formula: 'not {pressed}'}
"""


def test_it_is_told_with_what_it_is_called_here(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, MISSPELT)) as scene:
        adapter, peer = scene.adapter("misspelt"), scene.peer()
        peer.node.create_publisher(msg.String, "/estop_s", 10)  # of another type
        peer.node.create_publisher(msg.Bool, "/estop", 10)
        text = "nobody publishes /estops; did you mean /estop?"
        adapter.said(re.escape(f"/estops: {text}"))
        eventually(
            lambda: [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]], [text].__eq__
        )
        peer.publisher(msg.Bool, "/estops")
        adapter.said("/estops: recovered")


FILTERED = """
id: filtered
streams:
  - {topic: /cmd, type: std_msgs/msg/Bool, action: filter, intercept: publisher}
properties:
  - {id: stopped, formula: 'not {topic: /cmd, data: true}', guards: [/cmd]}
"""


def test_it_is_told_also_where_nobody_hears_what_passes(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, FILTERED)) as scene:
        adapter, recorder = scene.adapter("filtered"), scene.peer("recorder")
        recorder.record(msg.Bool, "/cmd_mon")
        unheard = "nobody hears /cmd, and past the monitor hears /cmd_mon: /recorder"
        adapter.said(re.escape(f"/cmd: {unheard}; nobody publishes /cmd_mon"))
