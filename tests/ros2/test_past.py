"""Who gets past the monitor on real ROS 2, where several nodes have one name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.robot import spec_folder
from tests.ros2.harness import Peer, Scene, eventually

endpoints = pytest.importorskip("oracle_ros2.endpoints")
graph = pytest.importorskip("oracle_ros2.graph")
republished = pytest.importorskip("oracle_ros2.republished")
rclpy = pytest.importorskip("rclpy")
rclpy_qos = pytest.importorskip("rclpy.qos")
msg = pytest.importorskip("std_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    with Scene(tmp_path) as scene:
        yield scene


def test_what_a_node_of_the_monitor_s_own_name_publishes_is_past_the_monitor(scene: Scene) -> None:
    monitor, twin = scene.peer("monitor"), scene.peer("monitor")
    forwarded = republished.MatchedPublisher(monitor.node, msg.Int64, "/cmd")
    eventually(lambda: forwarded.look([]), lambda trouble: trouble == "")
    past = twin.node.create_publisher(msg.Int64, "/cmd", 10)
    text = "another node named /monitor publishes /cmd past the monitor"
    eventually(lambda: forwarded.look([]), lambda trouble: trouble == text)
    assert forwarded.bypass == text
    twin.node.destroy_publisher(past)
    eventually(lambda: (forwarded.look([]), forwarded.bypass), lambda found: found == ("", ""))
    forwarded.stop()


def test_a_publisher_in_another_s_place_is_the_monitor_s_own(scene: Scene) -> None:
    monitor = scene.peer()
    forwarded = republished.MatchedPublisher(monitor.node, msg.Int64, "/cmd")
    effort = rclpy_qos.QoSProfile(depth=1, reliability=rclpy_qos.ReliabilityPolicy.BEST_EFFORT)
    told = []

    def offered() -> Any:
        told.append(forwarded.look([effort]))
        return [info.qos_profile.reliability for info in monitor.node.get_publishers_info_by_topic("/cmd")]

    eventually(offered, lambda found: found == [rclpy_qos.ReliabilityPolicy.BEST_EFFORT])
    assert {*told, forwarded.look([effort])} == {""}
    forwarded.stop()


def test_who_is_past_the_monitor_is_told_on_while_a_publisher_takes_another_s_place(scene: Scene) -> None:
    monitor, rogue = scene.peer("monitor"), scene.peer("rogue")
    forwarded = republished.MatchedPublisher(monitor.node, msg.Int64, "/cmd")
    effort = rclpy_qos.QoSProfile(depth=1, reliability=rclpy_qos.ReliabilityPolicy.BEST_EFFORT)
    past = rogue.node.create_publisher(msg.Int64, "/cmd", 10)
    text, told = "/rogue publishes /cmd past the monitor", []
    eventually(lambda: forwarded.look([]), lambda trouble: trouble == text)

    def offered() -> Any:
        told.append(forwarded.look([effort]))
        found = monitor.node.get_publishers_info_by_topic("/cmd")
        return [info.qos_profile.reliability for info in found if info.node_name == "monitor"]

    eventually(offered, lambda found: found == [rclpy_qos.ReliabilityPolicy.BEST_EFFORT])
    assert {*told, forwarded.look([effort])} == {text}
    reliable = rclpy_qos.QoSProfile(depth=1)
    forwarded.look([reliable])  # and who goes while it changes back has gone
    assert [info.node_name for info in monitor.node.get_publishers_info_by_topic("/cmd")].count("monitor") == 2
    rogue.node.destroy_publisher(past)
    eventually(lambda: monitor.node.count_publishers("/cmd"), lambda count: count == 2)
    assert forwarded.look([reliable]) == ""
    forwarded.stop()


def calls(monitor: Peer) -> str:
    return str(graph.past_proxy(monitor.node, ("/led", "/led_mon")))


@pytest.mark.parametrize(
    ("name", "doubled"), [("monitor", "/monitor"), ("pilot", "/pilot")], ids=["the monitor's", "another's"]
)
def test_who_calls_past_the_monitor_is_told_where_its_name_is_another_s_too(
    name: str, doubled: str, scene: Scene
) -> None:
    monitor = scene.peer("monitor")
    monitor.node.create_client(srv.Trigger, "/led")
    monitor.node.create_service(srv.Trigger, "/led_mon", lambda _, response: response)
    if name != "monitor":
        scene.peer(name)
        monitor.until(lambda: (name, "/") in monitor.node.get_node_names_and_namespaces(), "it is not discovered")
    assert calls(monitor) == ""
    twin = scene.peer(name)
    client = twin.node.create_client(srv.Trigger, "/led")
    text = f"another node named {doubled} can call /led past the monitor"
    eventually(lambda: calls(monitor), lambda trouble: trouble == text)
    twin.node.destroy_client(client)
    twin.node.create_service(srv.Trigger, "/led_mon", lambda _, response: response)
    text = f"another node named {doubled} serves /led_mon beside the monitor"
    eventually(lambda: calls(monitor), lambda trouble: trouble == text)


def test_who_calls_past_the_monitor_is_told_where_ros_has_moved_the_service(scene: Scene) -> None:
    monitor, pilot = scene.peer("monitor"), scene.peer("pilot")
    moved = ["--ros-args", "-r", "/led:=/base/led", "-r", "/led_mon:=/base/led_mon"]
    node = rclpy.create_node("moved", context=monitor.context, cli_args=moved)
    node.create_client(srv.Trigger, "/led")
    node.create_service(srv.Trigger, "/led_mon", lambda _, response: response)
    pilot.node.create_client(srv.Trigger, "/base/led")
    pilot.node.create_service(srv.Trigger, "/base/led_mon", lambda _, response: response)
    text = "/pilot can call /base/led past the monitor; /pilot serves /base/led_mon beside the monitor"
    eventually(lambda: graph.past_proxy(node, ("/led", "/led_mon")), lambda trouble: trouble == text)
    node.destroy_node()


def test_who_is_past_the_monitor_is_told_by_the_name_that_ros_has_given_the_topic(scene: Scene) -> None:
    monitor, pilot = scene.peer("monitor"), scene.peer("pilot")
    moved = ["--ros-args", "-r", "/cmd:=/base/cmd"]
    node = rclpy.create_node("moved", context=monitor.context, cli_args=moved)
    forwarded = republished.MatchedPublisher(node, msg.Int64, "/cmd")
    past = pilot.node.create_publisher(msg.Int64, "/base/cmd", 10)
    text = "/pilot publishes /base/cmd past the monitor"
    eventually(lambda: forwarded.look([]), lambda trouble: trouble == text)
    pilot.node.destroy_publisher(past)
    lasting = rclpy_qos.QoSProfile(depth=1, durability=rclpy_qos.DurabilityPolicy.TRANSIENT_LOCAL)
    pilot.record(msg.Int64, "/base/cmd", lasting)
    text = "/pilot can't receive /base/cmd: volatile publisher and transient local subscription"
    eventually(lambda: forwarded.look([]), lambda trouble: trouble == text)
    forwarded.stop()
    node.destroy_node()


GUARDED = """
id: guarded
streams:
  - {topic: /cmd, type: std_msgs/msg/Int64, action: filter, intercept: INTERCEPT}
properties:
  - {id: small, formula: 'not {topic: /cmd, data: 13}', guards: [/cmd]}
"""


@pytest.mark.parametrize(
    ("intercept", "heard", "given"),
    [("subscriber", "/cmd", "/cmd_mon"), ("publisher", "/cmd_mon", "/cmd")],
    ids=["subscriber", "publisher"],
)
def test_who_hears_past_the_monitor_is_told_where_nobody_hears_what_passes(
    tmp_path: Path, intercept: str, heard: str, given: str
) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, GUARDED.replace("INTERCEPT", intercept))) as scene:
        adapter, base, pilot = scene.adapter("guarded"), scene.peer("base"), scene.peer("pilot")
        base.record(msg.Int64, heard)
        pilot.publisher(msg.Int64, heard, listeners=2)
        text = f"nobody hears {given}, and past the monitor hears {heard}: /base"
        adapter.said(f"/cmd: {text}")
        eventually(
            lambda: [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]], [text].__eq__
        )
        base.record(msg.Int64, given)
        adapter.said("/cmd: recovered")


def test_an_endpoint_that_is_no_node_s_is_told_as_what_it_is() -> None:
    """As those of PX4, which come by an agent that speaks DDS alone."""
    node = SimpleNamespace(node_namespace="/base", node_name="arm")
    bare = SimpleNamespace(node_namespace="_CREATED_BY_BARE_DDS_APP_", node_name="_CREATED_BY_BARE_DDS_APP_")
    early = SimpleNamespace(node_namespace="_NODE_NAMESPACE_UNKNOWN_", node_name="_NODE_NAME_UNKNOWN_")
    told = ["/base/arm", "a program on DDS that is no ROS node", "a node of unknown name"]
    assert [endpoints.full_name(info) for info in (node, bare, early)] == told


def test_what_a_monitor_without_a_name_hides_is_nobody_else_s(scene: Scene) -> None:
    """A node that is a monitor, and not known by name yet, makes no monitors of all that have none."""
    robot, pilot = scene.peer("robot"), scene.peer("pilot")
    nodes = {"/pilot": pilot, "/uav2": scene.peer("uav2")}
    monitors = graph.Monitors(robot.node, endpoints.MatchedSubscription(robot.node, msg.String, "/said", lambda *_: 0))
    heard = monitors._heard
    for peer in nodes.values():
        peer.node.create_publisher(msg.String, "/said", 10)
    for name in ("verdict", "error"):
        nodes["/uav2"].node.create_publisher(msg.String, f"/uav2/monitor_{name}", 10)

    def theirs() -> dict[str, Any]:
        heard.look_around()
        monitors.look()
        return {source: heard.publisher(source) for source in heard.sources if monitors.have(source)}

    found = eventually(theirs, lambda sources: list(sources.values()) == ["/uav2"])
    ask = robot.node.get_publishers_info_by_topic

    def unnamed(topic: str) -> Any:
        found = ask(topic)
        for info in found:
            info.node_name = "_NODE_NAME_UNKNOWN_"
        return found

    robot.node.get_publishers_info_by_topic = unnamed
    assert theirs() == dict.fromkeys(found, "a node of unknown name")
    heard.stop()


def test_a_monitor_is_one_before_its_node_has_a_name() -> None:
    names = {"error": "_NODE_NAME_UNKNOWN_", "lines": "_NODE_NAME_UNKNOWN_", "bare": "_CREATED_BY_BARE_DDS_APP_"}
    participant, other = b"\1" * 12, b"\2" * 12
    gids = {"error": participant + b"\0\0\0\3", "lines": participant + b"\0\0\0\1", "bare": other + b"\0\0\0\1"}

    def info(which: str) -> Any:
        return SimpleNamespace(node_name=names[which], node_namespace="/", endpoint_gid=gids[which])

    def publisher(source: str) -> str | None:
        found = (endpoints.full_name(info(which)) for which in names if gids[which].hex() == source)
        return next(found, None)

    node = SimpleNamespace(
        get_topic_names_and_types=lambda: [("/uav2/monitor_error", []), ("/uav2/monitor_verdict", []), ("/rosout", [])],
        get_publishers_info_by_topic=lambda topic: [info("error")],
        get_fully_qualified_name=lambda: "/uav1",
    )
    monitors = graph.Monitors(node, SimpleNamespace(publisher=publisher, look_around=lambda: None, nodes=[]))
    lines, bare = gids["lines"].hex(), gids["bare"].hex()
    assert (monitors.have(lines), monitors.have(bare)) == (True, False)
    names["lines"] = "uav2"  # each publisher gets its node's name for itself
    assert monitors.have(lines)
    names["error"] = "uav2"
    monitors.look()
    assert (monitors.have(lines), monitors.have(bare)) == (True, False)
    names["lines"], names["error"] = "camera", "uav2"  # nodes of one process
    assert not monitors.have(lines)


def test_where_publishers_are_not_told_it_is_said_that_monitors_are_heard(scene: Scene) -> None:
    """As before Kilted: what it says of a violation is an event, which may violate again."""
    monitor = scene.peer("uav1")
    heard = endpoints.MatchedSubscription(monitor.node, msg.String, "/said", lambda *_: None)
    monitors = graph.Monitors(monitor.node, heard)
    monitors.look()
    assert monitors.doubt == ""
    assert not monitors.have("")
    monitors.look()
    assert monitors.doubt.endswith("what monitors say here is taken for the robot's")
    heard.stop()
