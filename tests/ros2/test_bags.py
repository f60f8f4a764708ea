"""Bags that are recorded and played on real ROS 2: in simulated time a live session judges as `replay` does."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.flights import ATTEMPTS, TOPICS
from tests.playback import fly, judged_alike, patient_spec, play_twice
from tests.processes import ROOT
from tests.ros2.harness import Scene

pytest.importorskip("battery_uav_msgs.msg")
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

BAG = (sys.executable, ROOT / "tests" / "ros2" / "bag.py")


def recorded(folder: Path) -> Path:
    """A countdown in a bag."""
    bag = folder / "flight"
    with Scene(folder / "recording") as scene:
        topics = [f"{topic}=battery_uav_msgs/msg/{kind}" for topic, kind in TOPICS.items()]
        recorder = scene.run("recorder", *BAG, "record", bag, *topics)
        recorder.said("recording")
        assert fly(scene, recorder) == 0
    return bag


def played(folder: Path) -> bool:
    """Play a bag to a session, twice, and compare; false where the machine was too slow for that."""
    folder.mkdir()
    specs, bag = patient_spec(folder), recorded(folder)
    with Scene(folder / "playing", specs) as scene:
        adapter = scene.adapter("battery_uav", more=["--ros-args", "-p", "use_sim_time:=true"])
        play_twice(adapter, lambda: scene.run("player", *BAG, "play", bag))
        return judged_alike(scene.server, specs, bag)


def test_a_bag_that_is_played_twice_is_judged_live_as_it_is_replayed(tmp_path: Path) -> None:
    assert any(played(tmp_path / str(attempt)) for attempt in range(ATTEMPTS)), "the machine is too busy"
