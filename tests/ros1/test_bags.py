"""Bags that rosbag records and plays, on real ROS 1: in simulated time a live session judges as `replay` does."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.flights import ATTEMPTS, RATES, SPEED, TOPICS
from tests.playback import judged_alike, patient_spec
from tests.processes import eventually
from tests.ros1.harness import Scene


def recorded(folder: Path) -> Path:
    """A countdown with a wrong status, as rosbag recorded it."""
    bag = folder / "flight.bag"
    rates = {module: {"rate": rate * SPEED} for module, rate in RATES.items()}
    with Scene(folder / "recording") as scene:
        recorder = scene.run("recorder", "rosbag", "record", "-O", bag, *TOPICS)
        panel = scene.node("led_panel", wait_for=1, **rates["led_panel"])
        faulty = {"fault": "wrong_status", "service": "/SetLED"}
        scene.node("supervisor", wait_for=1, **faulty, **rates["supervisor"])
        panel.said("ready")
        battery = scene.node("battery", wait_for=2, **rates["battery"])
        eventually(lambda: battery.running, lambda running: not running)
        recorder.end(signal.SIGINT)
    return bag


def play(scene: Scene, bag: Path) -> None:
    words = ("--clock", "--hz", 100, "--wait-for-subscribers")
    player = scene.run("player", "rosbag", "play", *words, bag)
    eventually(lambda: player.running, lambda running: not running)
    assert player.end() == 0


def played(folder: Path) -> bool:
    """Play a bag to a session, twice, and compare; false where the machine was too slow for that."""
    folder.mkdir()
    specs, bag = patient_spec(folder), recorded(folder)
    with Scene(folder / "playing", specs) as scene:
        scene.peer().parameter("/use_sim_time", True)
        adapter = scene.adapter("battery_uav")
        play(scene, bag)
        play(scene, bag)  # from the beginning: time goes back
        adapter.said(r"attached s\.run2")
        adapter.ends_well()
        return judged_alike(scene.server, specs, bag)


def test_a_bag_that_is_played_twice_is_judged_live_as_it_is_replayed(tmp_path: Path) -> None:
    assert any(played(tmp_path / str(attempt)) for attempt in range(ATTEMPTS)), "the machine is too busy"
