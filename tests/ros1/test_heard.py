"""Whom the ROS 1 adapter hears: who does not say its name, and not itself."""

from __future__ import annotations

import re
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from oracle_ros1 import unheard
from std_msgs.msg import Bool, Int64, String

from tests.processes import eventually
from tests.robot import spec_folder
from tests.ros1.harness import Scene
from tests.ros1.test_observed import WATCH

WELL = """
id: well
streams:
  - topic: /diagnostics
    type: diagnostic_msgs/DiagnosticArray
    each: msg.status
    signals: {level: item.level, source: item.name}
  - {topic: /rosout, type: rosgraph_msgs/Log, signals: {severity: msg.level}}
properties:
  - {id: all_well, formula: 'not {level >= 0}'}
  - {id: no_error, formula: 'not {severity >= 8}'}
"""


def test_what_a_monitor_says_of_violations_is_none_of_its_events(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WELL)) as scene:
        scene.adapter("well")
        peer = scene.peer()
        peer.record(DiagnosticArray, "/diagnostics", speakers=1)
        peer.advertise(DiagnosticArray, "/diagnostics", listeners=2)
        peer.publish("/diagnostics", DiagnosticArray(status=[DiagnosticStatus(name="motor")]))
        peer.until(  # the monitor has told of the violation, and of much else, and was heard
            lambda: any(s.level == 1 for array in peer.heard("/diagnostics") for s in array.status),
            lambda: "no warning is shown",
        )
        peer.publish("/diagnostics", DiagnosticArray(status=[DiagnosticStatus(name="pump")]))
        events = eventually(lambda: scene.server.events("s", stream="/diagnostics"), lambda found: len(found) >= 2)
        assert len(events) == 2
        assert scene.server.events("s", stream="/rosout") == []


def test_what_other_monitors_say_of_violations_is_no_event_once_the_master_has_told_of_them(tmp_path: Path) -> None:
    guarded = "streams:\n  - {topic: /go, type: std_msgs/Bool, action: filter, intercept: publisher}"
    spec = WELL.replace("streams:", guarded) + "  - {id: gone, formula: 'not {topic: /go, data: true}', guards: [/go]}"
    with Scene(tmp_path, spec_folder(tmp_path, spec)) as scene:
        scene.adapter("well", "one", "uav1")
        scene.adapter("well", "two", "uav2")
        peer = scene.peer()
        peer.record(DiagnosticArray, "/diagnostics", speakers=2)
        peer.advertise(DiagnosticArray, "/diagnostics", listeners=3)
        peer.advertise(Bool, "/go", listeners=0)

        def heard(session: str) -> tuple[int, int]:
            return tuple(len(scene.server.events(session, stream=stream)) for stream in ("/diagnostics", "/rosout"))

        def is_told(state: Any) -> bool:
            return any("past the monitor" in s["bypass"] for m in state["monitors"] for s in m["streams"])

        for session in ("one", "two"):  # the master was asked since all are there
            eventually(partial(scene.server.session, session), is_told)
        before = {session: heard(session) for session in ("one", "two")}
        peer.publish("/diagnostics", DiagnosticArray(status=[DiagnosticStatus(name="motor")]))
        shown = len(peer.heard("/diagnostics"))

        def said() -> set[str]:
            return {s.name for array in peer.heard("/diagnostics")[shown:] for s in array.status if s.level == 1}

        peer.until(lambda: {"uav1: all_well", "uav2: all_well"} <= said(), lambda: "nothing is violated")
        peer.publish("/diagnostics", DiagnosticArray(status=[DiagnosticStatus(name="pump")]))
        for session, (arrays, lines) in before.items():
            eventually(partial(heard, session), lambda found, least=arrays + 2: found[0] >= least)
            assert heard(session) == (arrays + 2, lines)


def test_a_monitor_does_not_hear_itself_where_ros_has_moved_its_diagnostics(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WELL)) as scene:
        scene.adapter("well", more=["/diagnostics:=/uav1/diagnostics"])
        peer = scene.peer()
        peer.record(DiagnosticArray, "/uav1/diagnostics", speakers=1)
        peer.advertise(DiagnosticArray, "/uav1/diagnostics", listeners=2)
        peer.publish("/uav1/diagnostics", DiagnosticArray(status=[DiagnosticStatus(name="motor")]))
        peer.until(
            lambda: any(s.level == 1 for array in peer.heard("/uav1/diagnostics") for s in array.status),
            lambda: "no warning is shown",
        )
        peer.publish("/uav1/diagnostics", DiagnosticArray(status=[DiagnosticStatus(name="pump")]))
        events = eventually(lambda: scene.server.events("s", stream="/diagnostics"), lambda found: len(found) >= 2)
        assert len(events) == 2


def test_who_may_be_no_monitor_is_told_where_it_is_left_out(tmp_path: Path) -> None:
    """As the player of a bag in which a monitor's topics are; a topic of errors alone makes nobody a monitor."""
    with Scene(tmp_path, spec_folder(tmp_path, WELL)) as scene:
        adapter, player, robot = scene.adapter("well"), scene.peer(), scene.peer()
        player.advertise(String, "/uav2/monitor_verdict", listeners=0)
        player.advertise(String, "/uav2/monitor_error", listeners=0)
        robot.advertise(String, "/motor/monitor_error", listeners=0)
        for node in (player, robot):
            node.advertise(DiagnosticArray, "/diagnostics", listeners=1)
            adapter.said(r"/diagnostics: /peer0 is taken for a monitor, as it publishes /uav2/monitor_error: ")
            node.publish("/diagnostics", DiagnosticArray(status=[DiagnosticStatus(name="motor")]))
        assert len(eventually(partial(scene.server.events, "s", stream="/diagnostics"), lambda found: found)) == 1
        assert "/peer1 is taken" not in adapter.log


def test_who_publishes_the_monitor_s_own_verdict_is_told(tmp_path: Path) -> None:
    """As another adapter of its name that `__ns` has moved, where one can't tell whose verdict it is."""
    with Scene(tmp_path, spec_folder(tmp_path, WELL)) as scene:
        words = ("--oracle", scene.server.url, "--spec", "well", "--monitor", "uav1", "__ns:=/robot2")
        command = ("env", sys.executable, "-m", "oracle_ros1", *words)  # not forked: rospy reads `__ns` once
        one, two = scene.adapter("well", "one"), scene.run("two", *command)
        rest = "publishes /uav1/monitor_verdict too, where one can't tell whose verdict it is: give each monitor a name"
        one.said(f"the monitor's name: /robot2/uav1 {rest}")
        two.said(f"the monitor's name: /uav1 {rest}")
        two.ends_well()
        one.said("the monitor's name: recovered")
        one.ends_well()


NAMELESS = """
import rospy
from rospy.impl.tcpros_pubsub import TCPROSPub
from std_msgs.msg import Int64

fields = TCPROSPub.get_header_fields
TCPROSPub.get_header_fields = lambda self: {k: v for k, v in fields(self).items() if k != "callerid"}
rospy.init_node("nameless")
rospy.Publisher("/number", Int64, latch=True, queue_size=1).publish(101)
rospy.spin()
"""


def test_a_publisher_that_does_not_say_its_name_is_heard(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        scene.adapter("watch")
        scene.run("nameless", sys.executable, "-c", NAMELESS)
        [violation] = eventually(lambda: scene.server.records("s", "violations"), len)
        assert (violation["property"], violation["stream"]) == ("small", "/number")


MISSPELT = """
id: misspelt
streams:
  - topic: /estops
    type: std_msgs/Bool
    signals: {pressed: msg.data}
properties:
  - {id: never_pressed, formula: 'not {pressed}'}
"""


def test_a_topic_that_nobody_publishes_is_told_with_what_it_is_called_here(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, MISSPELT)) as scene:
        adapter, peer = scene.adapter("misspelt"), scene.peer()
        peer.advertise(Bool, "/estop", listeners=0)
        text = "nobody publishes /estops; did you mean /estop?"
        adapter.said(re.escape(f"/estops: {text}"))
        eventually(
            lambda: [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]], [text].__eq__
        )
        peer.advertise(Bool, "/estops")
        adapter.said("/estops: recovered")


LOST = """
import os
os.environ["ROS_HOSTNAME"] = "robot.invalid"
del os.environ["ROS_IP"]
import rospy
from std_msgs.msg import Int64

rospy.init_node("lost")
said = rospy.Publisher("/number", Int64, latch=True, queue_size=1)
said.publish(101)
rospy.spin()
"""


def test_a_publisher_that_can_not_be_reached_is_told_though_others_are_heard(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        adapter, peer = scene.adapter("watch"), scene.peer()
        peer.advertise(Int64, "/number")
        lost = scene.run("lost", sys.executable, "-c", LOST)
        adapter.said(r"/number: /lost publishes /number, and nothing of it is heard: .* at http://robot\.invalid:\d+/")
        eventually(
            lambda: [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]],
            lambda found: "/lost publishes /number" in found[0],
        )
        lost.end()
        adapter.said("/number: recovered")
        adapter.ends_well()


HESITANT = """
import sys
import rospy
from rospy.impl.tcpros_pubsub import TCPROSHandler
from std_msgs.msg import Int64

connect, came = TCPROSHandler.topic_connection_handler, []

def hesitate(handler, connection, address, header):
    if header["topic"] == "/number" and not came:
        came.append(header)
        if sys.argv[1] == "refuses":
            return "not yet"
        raise RuntimeError("not now")
    return connect(handler, connection, address, header)

TCPROSHandler.topic_connection_handler = hesitate
rospy.init_node("hesitant")
said = rospy.Publisher("/number", Int64, latch=True, queue_size=1)
said.publish(101)
rospy.spin()
"""


@pytest.mark.parametrize("at_first", ["refuses", "hangs up"])
def test_a_publisher_that_refuses_or_hangs_up_at_first_is_connected_to_again(at_first: str, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, WATCH)) as scene:
        adapter = scene.adapter("watch")
        scene.run("hesitant", sys.executable, "-c", HESITANT, at_first)
        adapter.said("/number: /hesitant publishes /number, and nothing of it is heard: ")
        adapter.said("/number: recovered")
        [violation] = eventually(lambda: scene.server.records("s", "violations"), len)
        assert (violation["property"], violation["stream"]) == ("small", "/number")
        adapter.ends_well()


def test_such_a_publisher_is_tried_less_and_less_often() -> None:
    assert [count for count in range(1, 100) if unheard._is_due(count)] == [5, 10, 20, 40, 80]
