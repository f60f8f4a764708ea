"""The adapter in simulated time, on real ROS 2: /clock rules the stamps, and a jump back begins a new session."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.processes import PATIENCE
from tests.ros2.harness import Peer, Scene, eventually

Duration = pytest.importorskip("rclpy.duration").Duration
clock_msgs = pytest.importorskip("rosgraph_msgs.msg")
msg = pytest.importorskip("battery_uav_msgs.msg")
srv = pytest.importorskip("battery_uav_msgs.srv")
header = pytest.importorskip("std_msgs.msg").Header
time_msg = pytest.importorskip("builtin_interfaces.msg").Time

pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

SECOND = 10**9


class Simulation:
    """The clock of a simulated world, a battery in it and a panel."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        peer.node.create_service(srv.SetLED, "SetLED", lambda _, response: response)
        self._clock = peer.publisher(clock_msgs.Clock, "/clock")
        self._percentages = peer.publisher(msg.BatteryPercentage, "battery_percentage")

    def at(self, seconds: float) -> None:
        """Set the world's time."""
        self._clock.publish(clock_msgs.Clock(clock=stamp(seconds)))

    def percentage(self, number: int, seconds: float) -> None:
        """Publish one, which has arrived when this returns: the clock is not to overtake it."""
        made = header(stamp=stamp(seconds))
        self._percentages.publish(msg.BatteryPercentage(header=made, id=number, percentage=90.0))
        assert self._percentages.wait_for_all_acked(Duration(seconds=PATIENCE))

    def run_until(self, session: str, scene: Scene, start: float, count: int) -> float:
        """Let time go on, a tenth of a second at a time, until a session has judged so many events."""
        seconds = start

        def judged() -> int:
            nonlocal seconds
            seconds += 0.1
            self.at(seconds)
            sessions = {s["id"]: s for s in scene.server.get("sessions")["items"]}
            return int(sessions[session]["counters"]["steps"]) if session in sessions else 0

        self._peer.until(lambda: judged() >= count)
        return seconds


@pytest.mark.parametrize("back", [10, 0])  # 0: as where a simulated world is reset, and stands
def test_stamps_follow_the_clock_and_a_jump_back_begins_a_new_session(back: int, tmp_path: Path) -> None:
    with Scene(tmp_path / "scene") as scene:
        words = ("--oracle", scene.server.url, "--spec", "battery_uav", "--session", "s", "--monitor", "uav1")
        sim = ("--ros-args", "-p", "use_sim_time:=true")
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros2", *words, *sim)
        adapter.said("observing")
        peer = scene.peer()
        world = Simulation(peer)

        def heard() -> bool:
            world.at(100)  # a first message is lost where the adapter has not yet discovered who publishes it
            return any(s["frontier"] == 100 * SECOND for s in scene.server.session("s")["streams"])

        peer.until(heard)
        for number in range(1, 6):
            world.percentage(number, 100 + number / 100)
        now = world.run_until("s", scene, 100, 5)
        assert scene.server.session("s")["clock"] == "sim"
        peer.call(srv.SetLED, "SetLED_mon", srv.SetLED.Request(id=1, status=1))
        now = world.run_until("s", scene, now, 6)

        world.at(back)
        adapter.said("session_ended")
        ended = eventually(lambda: scene.server.session("s"), lambda s: s["status"] == "closed")
        assert ended["continued_by"] == "s.run2"
        adapter.said(r"attached s\.run2")
        for number in range(1, 4):
            world.percentage(number, back + number / 100)
        world.run_until("s.run2", scene, back, 3)

        second = eventually(lambda: scene.server.events("s.run2"), lambda records: len(records) == 3)
        first = scene.server.events("s")
        topics = [[r for r in records if r["kind"] == "topic"] for records in (first, second)]
        assert [r["stamp"] for r in topics[0]] == [100 * SECOND + n * 10**7 for n in range(1, 6)]
        assert [r["stamp"] for r in topics[1]] == [back * SECOND + n * 10**7 for n in range(1, 4)]
        (request,) = (r for r in first if r["kind"] == "request")
        assert 100 * SECOND < request["stamp"] <= (now + 1) * SECOND, "stamped by the adapter, in the world's time"
        assert not any(r["late"] or r["skewed"] for r in first + second)
        adapter.ends_well()


def stamp(seconds: float) -> object:
    return time_msg(sec=int(seconds), nanosec=round(seconds % 1 * SECOND))


def test_a_clock_that_does_not_come_is_told_until_it_does(tmp_path: Path) -> None:
    with Scene(tmp_path / "scene") as scene:
        adapter = scene.adapter("battery_uav", more=("--ros-args", "-p", "use_sim_time:=true"))
        adapter.said("simulated time: time stands at 0, so no deadline runs out: /clock is silent, or paused")
        peer = scene.peer()
        world = Simulation(peer)

        def told() -> bool:
            world.at(100)  # as above: a first message may be lost
            return "simulated time: recovered" in adapter.log

        peer.until(told)
        adapter.said(r"simulated time: time stands at 100\.000 s, so no deadline runs out")
        eventually(lambda: scene.server.session("s")["monitors"], lambda found: "time stands at 100" in str(found))
        adapter.ends_well()


def test_a_clock_that_tells_what_is_no_time_ends_nothing(tmp_path: Path) -> None:
    with Scene(tmp_path / "scene") as scene:
        adapter = scene.adapter("battery_uav", more=("--ros-args", "-p", "use_sim_time:=true"))
        peer = scene.peer()
        world = Simulation(peer)

        def told() -> bool:
            world.at(-5)
            return "/clock: a message can't be read: " in adapter.log

        peer.until(told)
        world.at(100)
        world.percentage(1, 100.01)
        world.run_until("s", scene, 100, 1)
        adapter.ends_well()


def test_two_nodes_that_tell_the_time_are_named_once_it_goes_back_and_until_one_has_gone(tmp_path: Path) -> None:
    with Scene(tmp_path / "scene") as scene:
        adapter = scene.adapter("battery_uav", more=("--ros-args", "-p", "use_sim_time:=true"))
        world, player = scene.peer("world"), scene.peer("player")
        clocks = [peer.publisher(clock_msgs.Clock, "/clock") for peer in (world, player)]

        def to_and_fro() -> bool:
            for clock, seconds in zip(clocks, (100, 50), strict=True):
                clock.publish(clock_msgs.Clock(clock=stamp(seconds)))
            return "time went back" in adapter.log

        world.until(to_and_fro)
        adapter.said("several publish /clock: /player, /world")
        player.node.destroy_publisher(clocks[1])
        adapter.said("simulated time: recovered")
        adapter.ends_well()


def test_a_clock_that_an_adapter_does_not_run_by_is_told_while_it_is_published(tmp_path: Path) -> None:
    def troubles() -> dict[tuple[str, str], str]:
        (monitor,) = scene.server.session("s")["monitors"]
        return {(told["stream"], told["kind"]): told["trouble"] or "" for told in monitor["streams"]}

    with Scene(tmp_path / "scene") as scene:
        adapter, world = scene.adapter("battery_uav"), scene.peer("world")
        clock = world.node.create_publisher(clock_msgs.Clock, "/clock", 10)
        adapter.said("simulated time: /clock is published by /world, and the adapter runs by the wall clock")
        stamped, not_stamped = ("/battery_percentage", "topic"), ("/SetLED", "request")
        told = eventually(troubles, lambda found: "use_sim_time:=true" in found[stamped])
        assert "/clock" not in told[not_stamped]
        world.node.destroy_publisher(clock)
        adapter.said("simulated time: recovered")
        eventually(troubles, lambda found: "/clock" not in found[stamped])
        adapter.ends_well()
