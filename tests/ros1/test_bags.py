"""Bags that rosbag records and plays, on real ROS 1: in simulated time a live session judges as `replay` does."""

from __future__ import annotations

import signal
from pathlib import Path

import rosbag
import rospy
from geometry_msgs.msg import PointStamped

from tests.flights import ATTEMPTS, TOPICS
from tests.playback import fly, judged_alike, patient_spec, play_twice
from tests.robot import spec_folder
from tests.ros1.harness import Scene

PLAY = ("rosbag", "play", "--clock", "--hz", 100, "--wait-for-subscribers")


def recorded(folder: Path) -> Path:
    """A countdown, as rosbag recorded it."""
    bag = folder / "flight.bag"
    with Scene(folder / "recording") as scene:
        fly(scene, scene.run("recorder", "rosbag", "record", "-O", bag, *TOPICS))
    return bag


def played(folder: Path) -> bool:
    """Play a bag to a session, twice, and compare; false where the machine was too slow for that."""
    folder.mkdir()
    specs, bag = patient_spec(folder), recorded(folder)
    with Scene(folder / "playing", specs) as scene:
        scene.peer().parameter("/use_sim_time", True)
        play_twice(scene.adapter("battery_uav"), lambda: scene.run("player", *PLAY, bag))
        return judged_alike(scene.server, specs, bag)


def test_a_bag_that_is_played_twice_is_judged_live_as_it_is_replayed(tmp_path: Path) -> None:
    assert any(played(tmp_path / str(attempt)) for attempt in range(ATTEMPTS)), "the machine is too busy"


POINTS = """
id: points
description: Points that go to the right
streams: [{topic: /point, type: geometry_msgs/PointStamped, latency: 500ms, signals: {left: msg.point.x < 0.0}}]
properties:
  - id: to_the_right
    formula: 'not {topic: "/point", left}'
"""
COUNT = 60
PERIOD = 50_000_000  # ns


def written(folder: Path) -> Path:
    """A bag of three seconds, longer than the default `max_skew`."""
    path = folder / "points.bag"
    with rosbag.Bag(str(path), "w") as bag:
        for number in range(COUNT):
            point = PointStamped()
            point.header.stamp = rospy.Time(1000, number % 20 * PERIOD) + rospy.Duration(number // 20)
            bag.write("/point", point, point.header.stamp)
    return path


def test_each_loop_of_a_bag_is_a_session_and_every_message_is_in_one(tmp_path: Path) -> None:
    bag = written(tmp_path)
    with Scene(tmp_path, spec_folder(tmp_path, POINTS)) as scene:
        scene.peer().parameter("/use_sim_time", True)
        adapter = scene.adapter("points")
        player = scene.run("player", *PLAY, "--loop", bag)
        adapter.said(r"attached s\.run4")
        player.end(signal.SIGINT)
        sessions = ["s", "s.run2", "s.run3"]
        loops = [scene.server.events(session) for session in sessions]
        stamps = [event["stamp"] for events in loops for event in events]
        counts = [stamps.count(1000 * 10**9 + number * PERIOD) for number in range(COUNT)]
        # The first of a loop may come before the clock that goes back, in the session before, and late there; its last
        # ones behind that, in the next session.
        assert counts == sorted(counts, reverse=True)
        assert set(counts) <= {4, 3, 2}
        assert counts[COUNT // 2] == 3
        assert [scene.server.session(session)["counters"]["lost"] for session in sessions] == [0, 0, 0]
        for events in loops:
            assert sum(event["late"] for event in events) < COUNT // 2
        adapter.ends_well()
