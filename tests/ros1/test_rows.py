"""Messages that are lists, on real ROS 1: each element is a step."""

from __future__ import annotations

from pathlib import Path

from sensor_msgs.msg import JointState

from tests.robot import JOINTS, by_joint, spec_folder
from tests.ros1.harness import Scene


def test_each_joint_of_a_message_is_judged(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, JOINTS)) as scene:
        adapter, peer = scene.adapter("joints"), scene.peer()
        peer.advertise(JointState, "/joint_states")
        there = JointState(name=["shoulder", "elbow"], position=[3, 2])
        beyond = JointState(name=["elbow", "shoulder"], position=[3, 2])
        peer.publish("/joint_states", there, beyond)
        by_joint(scene.server)
        adapter.ends_well()
