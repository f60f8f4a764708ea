"""What people see of the oracle on the ROS graph: the verdict, errors, and diagnostics."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.robot import spec_folder
from tests.ros2.harness import Peer, Scene, eventually

msg = pytest.importorskip("std_msgs.msg")
diagnostic = pytest.importorskip("diagnostic_msgs.msg")
screen = pytest.importorskip("oracle_ros2.screen")

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

SPEC = """
id: small
description: Numbers are small, and never negative
streams:
  - topic: /number
    type: std_msgs/msg/Int64
  - topic: /guarded
    type: std_msgs/msg/Int64
    action: filter
    intercept: publisher
    decide_within: 300ms
properties:
  - id: small
    formula: 'not {topic: "/number", data > 100}'
  - id: not_negative
    formula: 'historically not {topic: "/number", data < 0}'
  - id: even
    formula: 'not {topic: "/guarded", data: 13}'
    guards: [/guarded]
"""
OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))


class Seen:
    """What a node hears of a monitor that is shown as /fleet/uav_1."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.verdicts = peer.record(msg.String, "/fleet/uav_1/monitor_verdict", screen.LATEST)
        self.errors = peer.record(msg.String, "/fleet/uav_1/monitor_error", screen.ERRORS)
        self.arrays = peer.record(diagnostic.DiagnosticArray, "/diagnostics")

    def verdict(self, outcome: str) -> None:
        """Wait until this is the verdict."""
        said = [v.data for v in self.verdicts]
        self.peer.until(lambda: self.verdicts and self.verdicts[-1].data == outcome, f"not {outcome}, but {said}")

    def error(self, *parts: str) -> str:
        """Wait for an error with all of these in its text."""

        def found() -> list[str]:
            return [e.data for e in self.errors if all(part in e.data for part in parts)]

        self.peer.until(found, f"no error with {parts}: {self.errors}")
        return found()[0]

    def levels(self, **wanted: bytes) -> dict[str, Any]:
        """Wait until the diagnostics have these levels, and return them by name."""

        def last() -> dict[str, Any]:
            return {s.name.removeprefix("/fleet/uav-1: "): s for s in self.arrays[-1].status} if self.arrays else {}

        self.peer.until(lambda: all(n in last() and last()[n].level == v for n, v in wanted.items()), f"{last()}")
        return last()


def test_the_graph_sees_verdicts_errors_and_diagnostics(tmp_path: Path) -> None:
    specs = tmp_path / "specs"
    specs.mkdir()
    (specs / "small.yaml").write_text(SPEC, encoding="utf-8")
    with Scene(tmp_path, specs) as scene:
        adapter, peer = scene.adapter("small", monitor="/fleet/uav-1"), scene.peer()
        seen = Seen(peer)
        numbers, guarded = peer.publisher(msg.Int64, "/number"), peer.publisher(msg.Int64, "/guarded_mon")
        heard = peer.record(msg.Int64, "/guarded")
        peer.until(lambda: peer.node.count_publishers("/guarded"))
        seen.verdict("unknown")
        found = seen.levels(oracle=OK, small=STALE, not_negative=STALE)
        assert found["oracle"].hardware_id == "/fleet/uav-1"

        numbers.publish(msg.Int64(data=1))
        seen.verdict("currently_true")
        seen.levels(oracle=OK, small=OK, not_negative=OK)

        numbers.publish(msg.Int64(data=101))
        seen.verdict("currently_false")
        assert seen.levels(small=WARN, not_negative=OK)["small"].message == "does not hold at present"
        seen.error("violation", "small", "/number (topic", "data > 100")

        numbers.publish(msg.Int64(data=-1))
        seen.verdict("false")
        status = seen.levels(small=OK, not_negative=ERROR)["small"]
        assert {v.key: v.value for v in status.values}["violations"] == "1"

        guarded.publish(msg.Int64(data=13))
        guarded.publish(msg.Int64(data=12))
        peer.until(lambda: heard)
        assert [h.data for h in heard] == [12]
        assert seen.error("denied a message of /guarded") == "denied a message of /guarded: even"

        scene.server.kill()
        seen.verdict("unknown")
        assert "the oracle is away" in seen.levels(oracle=STALE, small=STALE, not_negative=STALE)["oracle"].message
        for number in range(3):
            guarded.publish(msg.Int64(data=number))
        seen.error("denied a message of /guarded: no connection")
        scene.server.restart()
        seen.verdict("false")
        seen.levels(oracle=OK, not_negative=ERROR)
        guarded.publish(msg.Int64(data=14))
        peer.until(lambda: len(heard) == 2)
        adapter.said("the oracle is back after .* 0 passed and 3 denied")
        assert len([e for e in seen.errors if "no connection" in e.data]) == 1

        late = Seen(peer)  # whoever comes later sees how it stands
        late.verdict("false")
        adapter.ends_well()


WELL = """
id: well
streams:
  - topic: /diagnostics
    type: diagnostic_msgs/msg/DiagnosticArray
    each: msg.status
    signals: {level: item.level, source: item.name}
  - {topic: /rosout, type: rcl_interfaces/msg/Log, signals: {severity: msg.level}}
properties:
  - {id: all_well, formula: 'not {level >= 0}'}
  - {id: no_error, formula: 'not {severity >= 40}'}
"""


def test_what_monitors_say_of_violations_is_none_of_their_events(tmp_path: Path) -> None:
    specs = tmp_path / "specs"
    specs.mkdir()
    (specs / "well.yaml").write_text(WELL, encoding="utf-8")
    with Scene(tmp_path, specs) as scene:
        scene.adapter("well", "one", monitor="/fleet/uav-1")
        scene.adapter("well", "two", monitor="/fleet/uav-2")
        peer = scene.peer()
        arrays = peer.record(diagnostic.DiagnosticArray, "/diagnostics")

        def warned() -> set[str]:
            return {s.name for array in arrays for s in array.status if s.level == WARN}

        publisher = peer.publisher(diagnostic.DiagnosticArray, "/diagnostics", listeners=3)
        publisher.publish(diagnostic.DiagnosticArray(status=[diagnostic.DiagnosticStatus(name="motor")]))
        # the monitors have told of the violation, and of much else, and were heard
        peer.until(lambda: {"/fleet/uav-1: all_well", "/fleet/uav-2: all_well"} <= warned(), "nothing is violated")
        publisher.publish(diagnostic.DiagnosticArray(status=[diagnostic.DiagnosticStatus(name="pump")]))
        for session in ("one", "two"):
            events = partial(scene.server.events, session, stream="/diagnostics")
            eventually(events, lambda found: len(found) >= 2)
            assert len(events()) == 2
            assert scene.server.events(session, stream="/rosout") == []


@pytest.mark.parametrize(
    ("remap", "topic"),
    [("/uav1/monitor_error:=/faults", "/diagnostics"), ("/diagnostics:=/uav1/health", "/uav1/health")],
)
def test_a_monitor_does_not_hear_itself_where_ros_has_moved_its_topics(tmp_path: Path, remap: str, topic: str) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WELL)) as scene:
        scene.adapter("well", more=("--ros-args", "-r", remap))
        peer = scene.peer()
        arrays = peer.record(diagnostic.DiagnosticArray, topic)
        publisher = peer.publisher(diagnostic.DiagnosticArray, topic, listeners=2)
        publisher.publish(diagnostic.DiagnosticArray(status=[diagnostic.DiagnosticStatus(name="motor")]))
        peer.until(lambda: any(s.level == WARN for array in arrays for s in array.status), "nothing is violated")
        publisher.publish(diagnostic.DiagnosticArray(status=[diagnostic.DiagnosticStatus(name="pump")]))
        events = partial(scene.server.events, "s", stream="/diagnostics")
        eventually(events, lambda found: len(found) >= 2)
        assert len(events()) == 2
        assert scene.server.events("s", stream="/rosout") == []


def test_who_may_be_no_monitor_is_told_where_it_is_left_out(tmp_path: Path) -> None:
    """As the player of a bag in which a monitor's topics are; a topic of errors alone makes nobody a monitor."""
    with Scene(tmp_path, spec_folder(tmp_path, WELL)) as scene:
        adapter, player, robot = scene.adapter("well"), scene.peer("player"), scene.peer("robot")
        for node, names in ((player, ("verdict", "error")), (robot, ("error",))):
            for name in names:
                node.node.create_publisher(msg.String, f"/{node.node.get_name()}_1/monitor_{name}", 10)
        for node in (player, robot):
            said = node.publisher(diagnostic.DiagnosticArray, "/diagnostics", listeners=1)
            adapter.said(r"/diagnostics: /player is taken for a monitor, as it publishes /player_1/monitor_error: ")
            said.publish(diagnostic.DiagnosticArray(status=[diagnostic.DiagnosticStatus(name=node.node.get_name())]))
        events = partial(scene.server.events, "s", stream="/diagnostics")
        assert len(eventually(events, lambda found: found)) == 1
        assert "/robot is taken" not in adapter.log


def test_two_monitors_of_one_name_tell_that_their_verdicts_are_on_one_topic(tmp_path: Path) -> None:
    """As two without `--monitor` are, also where each has a namespace of its own."""
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        one = scene.adapter("small", "one")
        two = scene.adapter("small", "two", more=("--ros-args", "-r", "__ns:=/robot2"))
        rest = "publishes /uav1/monitor_verdict too, where one can't tell whose verdict it is: give each monitor a name"
        one.said(f"the monitor's name: /robot2/uav1 {rest}")
        two.said(f"the monitor's name: /uav1 {rest}")
        two.ends_well()
        one.said("the monitor's name: recovered")
        again = scene.adapter("small", "two")
        one.said(f"the monitor's name: another node named /uav1 {rest}")
        again.ends_well()
        one.ends_well()
