"""Whose time is published on /clock on real ROS 1, and whether the adapter runs by it."""

from __future__ import annotations

from pathlib import Path

import rospy
from rosgraph_msgs.msg import Clock

from tests.processes import eventually
from tests.robot import spec_folder
from tests.ros1.harness import Scene

WATCH = """
id: watch
streams:
  - {topic: /number, type: std_msgs/Int64}
  - {topic: /point, type: geometry_msgs/PointStamped}
properties:
  - {id: small, formula: 'not {topic: "/number", data > 100}'}
"""


def test_a_clock_that_an_adapter_does_not_run_by_is_told_while_it_is_published(tmp_path: Path) -> None:
    def troubles() -> dict[str, str]:
        (monitor,) = scene.server.session("s")["monitors"]
        return {told["stream"]: told["trouble"] or "" for told in monitor["streams"]}

    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        adapter, world = scene.adapter("watch"), scene.peer()
        world.advertise(Clock, "/clock", listeners=0)
        adapter.said("simulated time: /clock is published by /peer0, and the adapter runs by the wall clock")
        told = eventually(troubles, lambda found: "/use_sim_time" in found["/point"])
        assert "/clock" not in told["/number"]  # which is ordered by its arrival
        world.withdraw("/clock")
        adapter.said("simulated time: recovered")
        eventually(troubles, lambda found: "/clock" not in found["/point"])
        adapter.ends_well()


def test_two_nodes_that_tell_the_time_are_named_once_it_goes_back_and_until_one_has_gone(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        world, player = scene.peer(), scene.peer()
        world.parameter("/use_sim_time", True)
        adapter = scene.adapter("watch")
        for peer in (world, player):
            peer.advertise(Clock, "/clock")

        def to_and_fro() -> bool:
            for peer, seconds in ((world, 100), (player, 50)):
                peer.publish("/clock", Clock(rospy.Time(seconds)))
            return "time went back" in adapter.log

        eventually(to_and_fro, bool)
        adapter.said("several publish /clock: /peer0, /peer1")
        player.withdraw("/clock")
        adapter.said("simulated time: recovered")
        adapter.ends_well()
