"""The battery UAV on real ROS 1, watched by a real oracle through the adapter."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import pytest
from battery_uav_msgs import msg

from tests import flights
from tests.flights import CHECKS, TOPICS, Ears, called_inside, kill_twice, killed_twice
from tests.ros1.harness import Scene


def listen(scene: Scene) -> Ears:
    peer = scene.peer()
    for topic, kind in TOPICS.items():
        peer.record(getattr(msg, kind), topic)
    return Ears(peer.heard, lambda condition, what: peer.until(condition, lambda: what), stamp)


def stamp(message: Any) -> int:
    return int(message.header.stamp.to_nsec())


landed = partial(flights.landed, Scene, listen)


@pytest.mark.parametrize("fault", CHECKS)
def test_a_countdown_gets_the_verdicts_of_its_fault(fault: str, tmp_path: Path) -> None:
    with landed(tmp_path, fault) as flown:
        CHECKS[fault](flown)


def test_a_supervisor_that_calls_inside_its_round_completes(tmp_path: Path) -> None:
    with landed(tmp_path, call_inside_callback=True) as flown:
        called_inside(flown)


def test_a_server_killed_twice_loses_nothing_and_judges_nothing_twice(tmp_path: Path) -> None:
    with landed(tmp_path, act=kill_twice, undecided=True, speed=0.5) as flown:
        killed_twice(flown)
