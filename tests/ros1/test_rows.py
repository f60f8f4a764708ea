"""Messages that are lists, on real ROS 1: each element is a step."""

from __future__ import annotations

from pathlib import Path

from sensor_msgs.msg import JointState
from std_msgs.msg import ByteMultiArray

from tests.processes import eventually
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


BYTES = """
id: bytes
description: No byte is negative
streams:
  - topic: /bytes
    type: std_msgs/ByteMultiArray
    each: msg.data
    signals: {one: item, first: 'msg.data[0]'}
properties:
  - {id: positive, formula: '{topic: "/bytes"} -> {one >= 0}'}
"""


def test_the_signed_numbers_of_bytes_are_judged_by_a_server(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, BYTES)) as scene:
        adapter, peer = scene.adapter("bytes"), scene.peer()
        peer.advertise(ByteMultiArray, "/bytes")
        peer.publish("/bytes", ByteMultiArray(data=[5, -1]))
        records = eventually(lambda: scene.server.records("s"), lambda found: len(found) == 2)
        assert [record["violation"] for record in records] == [False, True]
        adapter.ends_well()
