"""Bags that are recorded and played on real ROS 2: in simulated time a live session judges as `replay` does."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from tests.flights import ATTEMPTS, RATES, SPEED, TOPICS
from tests.playback import judged_alike, patient_spec
from tests.processes import ROOT
from tests.ros2.harness import Scene, eventually

pytest.importorskip("battery_uav_msgs.msg")
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

BAG = ROOT / "tests" / "ros2" / "bag.py"


def recorded(folder: Path) -> Path:
    """A countdown with a wrong status in a bag."""
    bag = folder / "flight"
    rates = {module: {"rate": rate * SPEED} for module, rate in RATES.items()}
    with Scene(folder / "recording") as scene:
        topics = [f"{topic}=battery_uav_msgs/msg/{kind}" for topic, kind in TOPICS.items()]
        recorder = scene.run("recorder", sys.executable, BAG, "record", bag, *topics)
        recorder.said("recording")
        panel = scene.node("led_panel", wait_for=1, **rates["led_panel"])
        faulty = {"fault": "wrong_status", "service": "/SetLED"}
        scene.node("supervisor", wait_for=1, **faulty, **rates["supervisor"])
        panel.said("ready")
        battery = scene.node("battery", wait_for=2, **rates["battery"])
        eventually(lambda: battery.running, lambda running: not running)
        assert recorder.end(signal.SIGINT) == 0
    return bag


def play(scene: Scene, bag: Path) -> None:
    player = scene.run("player", sys.executable, BAG, "play", bag)
    eventually(lambda: player.running, lambda running: not running)
    assert player.end() == 0


def played(folder: Path) -> bool:
    """Play a bag to a session, twice, and compare; false where the machine was too slow for that."""
    folder.mkdir()
    specs, bag = patient_spec(folder), recorded(folder)
    with Scene(folder / "playing", specs) as scene:
        adapter = scene.adapter("battery_uav", more=["--ros-args", "-p", "use_sim_time:=true"])
        play(scene, bag)
        play(scene, bag)  # from the beginning: time goes back
        adapter.said(r"attached s\.run2")
        adapter.ends_well()
        return judged_alike(scene.server, specs, bag)


def test_a_bag_that_is_played_twice_is_judged_live_as_it_is_replayed(tmp_path: Path) -> None:
    assert any(played(tmp_path / str(attempt)) for attempt in range(ATTEMPTS)), "the machine is too busy"
