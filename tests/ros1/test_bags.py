"""Bags that rosbag records and plays, on real ROS 1: in simulated time a live session judges as `replay` does."""

from __future__ import annotations

from pathlib import Path

from tests.flights import ATTEMPTS, TOPICS
from tests.playback import fly, judged_alike, patient_spec, play_twice
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
