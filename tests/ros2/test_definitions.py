"""Nodes that have another definition of a type, as of another version of its package.

The graph is told so here: there are no two definitions of one type in an environment. And those that call a service by
another type.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.robot import spec_folder
from tests.ros2.harness import Peer, Scene, eventually
from tests.ros2.test_qos import EFFORT, LASTING, profile, pytestmark, scene

__all__ = ["pytestmark", "scene"]
endpoints = pytest.importorskip("oracle_ros2.endpoints")
republished = pytest.importorskip("oracle_ros2.republished")
topics = pytest.importorskip("oracle_ros2.topics")
type_hash = pytest.importorskip("rclpy.type_hash")
msg = pytest.importorskip("std_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")
calltypes = pytest.importorskip("oracle_ros2.calltypes")

STREAM = {"name": "/n", "kind": "topic", "type": "std_msgs/msg/Int64", "stamp": None, "latency": 0, "fields": ["data"]}

LED = """
id: led
streams:
  - {service: /led, type: std_srvs/srv/Trigger}
properties:
  - {id: works, formula: '{kind: response} -> {success: true}'}
"""


def define_otherwise(monitor: Peer, name: str) -> None:
    """Let the graph tell a monitor of another definition of what a node has."""
    for ask in ("get_publishers_info_by_topic", "get_subscriptions_info_by_topic"):
        original = getattr(monitor.node, ask)

        def told(topic: str, asked: Any = original, **how: Any) -> Any:
            found = asked(topic, **how)
            for info in found:
                if info.node_name == name:
                    info.topic_type_hash = type_hash.TypeHash(version=1, value=bytes(32))
            return found

        setattr(monitor.node, ask, told)


def named(monitor: Peer, name: str) -> None:
    """Until a monitor knows whose publisher it is, by which it is told of another definition here."""
    ask = monitor.node.get_publishers_info_by_topic
    eventually(lambda: [info.node_name for info in ask("/n")], lambda names: name in names)


def as_told(info: Any, middleware: str) -> Any:
    """What a middleware tells of a message; Cyclone DDS has a number of its own for whose it is."""
    if middleware == "fastdds":
        return info
    own = info["publisher_gid"]["data"][-8:] + bytes(8)
    return {**info, "publisher_gid": {"data": own}, "publication_sequence_number": None}


@pytest.mark.parametrize(("middleware", "expected"), [("fastdds", [(5, 1)]), ("cyclone", [])])
def test_what_is_defined_otherwise_is_told_and_not_read(
    scene: Scene, middleware: str, expected: list[tuple[int, int]]
) -> None:
    """Where it is not told whose a message is, none of the topic's is read."""
    monitor, pilot, other = scene.peer("monitor"), scene.peer("pilot"), scene.peer("other")
    define_otherwise(monitor, "other")
    observed = topics.Observed(monitor.node, STREAM)
    read: list[tuple[int, int]] = []

    def take(message: bytes, info: Any) -> None:
        event = observed.event(message, as_told(info, middleware))
        if event is not None:
            _, data, more = event
            read.append((data["data"], more["lost"]))

    heard = endpoints.MatchedSubscription(monitor.node, msg.Int64, "/n", take)
    observed.is_foreign = heard.is_foreign
    right, wrong = pilot.publisher(msg.Int64, "/n"), other.publisher(msg.Int64, "/n")
    named(monitor, "other")
    wrong.publish(msg.Int64(data=13))
    monitor.until(lambda: observed.count == 1)
    right.publish(msg.Int64(data=5))
    monitor.until(lambda: observed.count == 2)
    assert read == expected
    text = "/other publishes it by another definition of std_msgs/msg/Int64 than is installed here"
    eventually(heard.look, lambda trouble: trouble == text)
    other.node.destroy_publisher(wrong)
    eventually(heard.look, lambda trouble: trouble == "")
    heard.stop()


def test_what_is_defined_otherwise_is_not_read_as_its_node_comes_where_sources_are_not_told(scene: Scene) -> None:
    """As of `ros2 topic pub --once` on another machine: it publishes before anybody has looked again."""
    monitor, pilot, other = scene.peer("monitor"), scene.peer("pilot"), scene.peer("other")
    define_otherwise(monitor, "other")
    asked: list[bool] = []
    heard = endpoints.MatchedSubscription(monitor.node, msg.Int64, "/n", lambda *_: asked.append(heard.is_foreign("")))
    pilot.publisher(msg.Int64, "/n").publish(msg.Int64(data=5))
    monitor.until(lambda: len(asked) == 1)
    wrong = other.publisher(msg.Int64, "/n")
    named(monitor, "other")
    wrong.publish(msg.Int64(data=13))
    monitor.until(lambda: len(asked) == 2)
    assert asked == [False, True]
    heard.stop()


def test_one_of_the_monitor_s_name_with_an_older_definition_does_not_stand_for_it(scene: Scene) -> None:
    before, monitor, pilot = scene.peer("monitor"), scene.peer("monitor"), scene.peer("pilot")
    before.record(msg.Int64, "/n")
    ask = monitor.node.get_subscriptions_info_by_topic
    eventually(lambda: ask("/n"), len)
    ghosts = [bytes(info.endpoint_gid) for info in ask("/n")]

    def told(topic: str) -> Any:
        found = ask(topic)
        for info in found:
            if bytes(info.endpoint_gid) in ghosts:
                info.topic_type_hash = type_hash.TypeHash(version=1, value=bytes(32))
        return found

    monitor.node.get_subscriptions_info_by_topic = told
    pilot.publisher(msg.Int64, "/n")
    eventually(lambda: monitor.node.get_publishers_info_by_topic("/n"), len)
    heard = endpoints.MatchedSubscription(monitor.node, msg.Int64, "/n", lambda *_: None)
    [source] = heard.sources
    assert heard.look() == ""
    assert not heard.is_foreign(source)
    heard.stop()


def test_who_publishes_another_type_keeps_nothing_from_being_read_where_sources_are_not_told(scene: Scene) -> None:
    monitor, pilot, other = scene.peer("monitor"), scene.peer("pilot"), scene.peer("other")
    heard = endpoints.MatchedSubscription(monitor.node, msg.Int64, "/n", lambda *_: None)
    pilot.publisher(msg.Int64, "/n")
    other.node.create_publisher(msg.String, "/n", 10)
    text = "/other publishes it as std_msgs/msg/String, not as std_msgs/msg/Int64"
    eventually(heard.look, lambda trouble: trouble == text)
    eventually(lambda: heard.sources, lambda found: len(found) == 2)
    assert not heard.is_foreign("")
    heard.stop()


def test_what_publishers_of_another_type_offer_does_not_count(scene: Scene) -> None:
    """They do not match by their type: what they offer is no reason to do without what others have kept."""
    monitor, pilot, other = scene.peer("monitor"), scene.peer("pilot"), scene.peer("other")
    kept = pilot.node.create_publisher(msg.Int64, "/n", profile(durability=LASTING))
    kept.publish(msg.Int64(data=5))
    other.node.create_publisher(msg.String, "/n", profile(EFFORT))
    eventually(lambda: monitor.node.count_publishers("/n"), lambda count: count == 2)
    taken: list[bytes] = []
    heard = endpoints.MatchedSubscription(monitor.node, msg.Int64, "/n", lambda message, _: taken.append(message))
    text = "/other publishes it as std_msgs/msg/String, not as std_msgs/msg/Int64"
    eventually(heard.look, lambda trouble: trouble == text)
    assert heard.lasts()
    monitor.until(lambda: taken, "what was kept does not come")
    heard.stop()


def test_who_can_t_read_what_is_forwarded_is_told(scene: Scene) -> None:
    monitor, other = scene.peer("monitor"), scene.peer("other")
    define_otherwise(monitor, "other")
    forwarded = republished.MatchedPublisher(monitor.node, msg.Int64, "/n")
    other.record(msg.Int64, "/n")
    text = "/other can't receive /n: it has another definition of std_msgs/msg/Int64 than is installed here"
    eventually(lambda: forwarded.look([]), lambda trouble: trouble == text)
    forwarded.stop()


def test_who_reads_what_is_forwarded_as_another_type_is_told_so(scene: Scene) -> None:
    monitor, other = scene.peer("monitor"), scene.peer("other")
    forwarded = republished.MatchedPublisher(monitor.node, msg.Int64, "/n")
    other.record(msg.Int32, "/n")
    text = "/other can't receive /n: it subscribes to it as std_msgs/msg/Int32, not as std_msgs/msg/Int64"
    eventually(lambda: forwarded.look([]), lambda trouble: trouble == text)
    forwarded.stop()


def proxied(monitor: Peer) -> Any:
    """The types of a service that a monitor serves and calls."""
    monitor.made.append(monitor.node.create_service(srv.Trigger, "/led_mon", lambda _, response: response))
    monitor.made.append(monitor.node.create_client(srv.Trigger, "/led"))
    return calltypes.CallTypes(monitor.node, "/led", "/led_mon")


def test_who_calls_and_serves_by_another_definition_is_told(scene: Scene) -> None:
    monitor, other, panel = scene.peer("monitor"), scene.peer("other"), scene.peer("panel")
    define_otherwise(monitor, "other")
    types = proxied(monitor)
    for node in (other, panel):
        node.made.append(node.node.create_service(srv.Trigger, "/led", lambda _, response: response))
        node.made.append(node.node.create_client(srv.Trigger, "/led_mon"))
    how = "by another definition of std_srvs/srv/Trigger than is installed here"
    told = [f"/other calls /led_mon {how}: it gets no answer", f"/other serves /led {how}: no call reaches it"]
    eventually(lambda: list(types.troubles()), lambda found: found == told)


def test_who_calls_and_serves_by_another_type_is_told(scene: Scene) -> None:
    monitor, other, panel = scene.peer("monitor"), scene.peer("other"), scene.peer("panel")
    types = proxied(monitor)
    panel.made.append(panel.node.create_service(srv.Trigger, "/led", lambda _, response: response))
    other.made.append(other.node.create_client(srv.SetBool, "/led_mon"))
    other.made.append(other.node.create_service(srv.SetBool, "/led", lambda _, response: response))
    how = "as std_srvs/srv/SetBool, not as std_srvs/srv/Trigger"
    told = [f"/other calls /led_mon {how}: it gets no answer", f"/other serves /led {how}: no call reaches it"]
    eventually(lambda: list(types.troubles()), lambda found: found == told)


def test_a_client_of_another_type_is_a_trouble_of_the_proxy(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, LED)) as scene:
        adapter, peer = scene.adapter("led"), scene.peer()
        peer.made.append(peer.node.create_client(srv.SetBool, "/led_mon"))
        adapter.said(
            "/led: /peer calls /led_mon as std_srvs/srv/SetBool, not as std_srvs/srv/Trigger: it gets no answer"
        )
