"""Messages that are lists, on real ROS 2: each element is a step."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.robot import JOINTS, by_joint, spec_folder
from tests.ros2.harness import Scene

msg = pytest.importorskip("sensor_msgs.msg")

pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def test_each_joint_of_a_message_is_judged(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, JOINTS)) as scene:
        adapter, peer = scene.adapter("joints"), scene.peer()
        publisher = peer.publisher(msg.JointState, "/joint_states")
        publisher.publish(msg.JointState(name=["shoulder", "elbow"], position=[3.0, 2.0]))
        publisher.publish(msg.JointState(name=["elbow", "shoulder"], position=[3.0, 2.0]))
        by_joint(scene.server)
        adapter.ends_well()
