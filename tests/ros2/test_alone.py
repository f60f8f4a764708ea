"""An adapter that is on no robot's graph, on real ROS 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.ros2.harness import Scene, eventually

SPEC = """
id: quiet
description: Nothing is wrong where nothing is heard
streams:
  - {topic: /first, type: std_msgs/Int64, signals: {one: msg.data}}
  - {topic: /second, type: std_msgs/Int64, signals: {two: msg.data}}
properties:
  - {id: small, formula: 'not {one > 100}'}
"""

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)


def test_that_no_other_node_is_on_the_graph_is_told_until_one_is(tmp_path: Path) -> None:
    specs = tmp_path / "specs"
    specs.mkdir()
    (specs / "quiet.yaml").write_text(SPEC)
    with Scene(tmp_path, specs) as scene:
        adapter = scene.adapter("quiet")

        def troubles() -> list[str]:
            [monitor] = scene.server.session("s")["monitors"]
            return [stream["trouble"] for stream in monitor["streams"]]

        first, second = eventually(troubles, lambda found: ["nobody publishes" in one for one in found] == [True, True])
        text = "no other node is on the ROS graph: start the adapter with the settings of the robot's nodes"
        assert text in first
        assert f"ROS_DOMAIN_ID is {scene.domain}" in first
        assert text not in second
        adapter.said(f"the ROS graph: {text}")
        scene.peer()
        eventually(troubles, lambda found: found == ["nobody publishes /first", "nobody publishes /second"])
        adapter.said("the ROS graph: recovered")
        adapter.ends_well()
