"""The battery UAV on real ROS 2, watched by a real oracle through the adapter.

REPEAT says how many clean countdowns there are in a row (3).
"""

from __future__ import annotations

import os
import signal
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from benchmarks.paper.algorithm1 import Arrival, never_released
from tests import flights
from tests.flights import CHECKS, TOPICS, Ears, Flight, Flown, called_inside, kill_twice, killed_twice
from tests.ros2.harness import Peer, Scene, without_gaps

msg = pytest.importorskip("battery_uav_msgs.msg")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def listen(scene: Scene) -> Ears:
    peer: Peer = scene.peer()
    heard = {topic: peer.record(getattr(msg, kind), topic) for topic, kind in TOPICS.items()}
    return Ears(heard.__getitem__, peer.until, stamp)


def stamp(message: Any) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


landed = partial(flights.landed, Scene, listen)


@pytest.mark.parametrize("fault", [*CHECKS, *["none"] * (int(os.environ.get("REPEAT", "3")) - 1)])
def test_a_countdown_gets_the_verdicts_of_its_fault(fault: str, tmp_path: Path) -> None:
    with landed(tmp_path, fault) as flown:
        CHECKS[fault](flown)


def test_a_supervisor_that_calls_inside_its_callback_completes(tmp_path: Path) -> None:
    with landed(tmp_path, call_inside_callback=True) as flown:
        called_inside(flown)
        assert flown.server.get("specs/battery_uav")["text"].count("by: publication") == 1
        [first, *_] = flown.server.events("s", stream="/SetLED")
        stuck = never_released(arrivals(flown), says_after)
        assert [a.stamp for a in stuck] == [first["stamp"]], "Algorithm 1 waits for ever at the first call"


def arrivals(flown: Flown) -> list[Arrival]:
    """What the paper's monitor puts in order, as it arrived here."""
    return [
        Arrival(event["stream"], event["stamp"], event["arrived"], event["kind"])
        for event in flown.server.events("s")
        if event["stream"] in ("/battery_percentage", "/input_accepted", "/battery_status", "/SetLED")
    ]


def says_after(later: Arrival, request: Arrival) -> bool:
    """Whether the supervisor, which waits inside its callback, could not say this before the call was over."""
    return later.buffer != "/battery_percentage" and later.stamp > request.stamp


def test_a_server_killed_twice_loses_nothing_and_judges_nothing_twice(tmp_path: Path) -> None:
    with landed(tmp_path, act=kill_twice, undecided=True, speed=0.5) as flown:
        killed_twice(flown)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_adapter_ends_cleanly_in_mid_flight(number: signal.Signals, tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        flight = Flight(scene, listen(scene))
        flight.passes(20)
        flight.ears.until(lambda: all(flight.ears.heard(topic) for topic in TOPICS), "a topic on which nothing is said")
        before = {topic: [stamp(said) for said in flight.ears.heard(topic)] for topic in TOPICS}
        flight.adapter.ends_well(number)
        [monitor] = flight.server.session("s")["monitors"]
        assert not monitor["attached"]
        events = flight.server.events("s")
        assert without_gaps([event["seq"] for event in events])
        assert flight.server.session("s")["counters"]["held"] == 0
        taken = {(event["stream"], event["stamp"]) for event in events}
        ends = {stream: max((at for name, at in taken if name == stream), default=0) for stream in before}
        for topic, stamps in before.items():
            assert {(topic, at) for at in stamps if at <= ends[topic]} <= taken
