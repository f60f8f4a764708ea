"""Nodes that have another definition of a type, as of another version of its package.

The graph is told so here: there are no two definitions of one type in an environment.
"""

from __future__ import annotations

from typing import Any

import pytest

from tests.ros2.harness import Peer, Scene, eventually
from tests.ros2.test_qos import pytestmark, scene

__all__ = ["pytestmark", "scene"]
endpoints = pytest.importorskip("oracle_ros2.endpoints")
republished = pytest.importorskip("oracle_ros2.republished")
topics = pytest.importorskip("oracle_ros2.topics")
type_hash = pytest.importorskip("rclpy.type_hash")
msg = pytest.importorskip("std_msgs.msg")

STREAM = {"name": "/n", "kind": "topic", "type": "std_msgs/msg/Int64", "stamp": None, "latency": 0, "fields": ["data"]}


def define_otherwise(monitor: Peer, name: str) -> None:
    """Let the graph tell a monitor of another definition of what a node has."""
    for ask in ("get_publishers_info_by_topic", "get_subscriptions_info_by_topic"):
        original = getattr(monitor.node, ask)

        def told(topic: str, asked: Any = original) -> Any:
            found = asked(topic)
            for info in found:
                if info.node_name == name:
                    info.topic_type_hash = type_hash.TypeHash(version=1, value=bytes(32))
            return found

        setattr(monitor.node, ask, told)


def test_what_is_defined_otherwise_is_told_and_not_read(scene: Scene) -> None:
    monitor, pilot, other = scene.peer("monitor"), scene.peer("pilot"), scene.peer("other")
    define_otherwise(monitor, "other")
    observed = topics.Observed(monitor.node, STREAM)
    read: list[tuple[int, int]] = []

    def take(message: bytes, info: Any) -> None:
        event = observed.event(message, info)
        if event is not None:
            _, data, more = event
            read.append((data["data"], more["lost"]))

    heard = endpoints.MatchedSubscription(monitor.node, msg.Int64, "/n", take)
    observed.is_foreign = heard.is_foreign
    right, wrong = pilot.publisher(msg.Int64, "/n"), other.publisher(msg.Int64, "/n")
    wrong.publish(msg.Int64(data=13))
    monitor.until(lambda: observed.count == 1)
    right.publish(msg.Int64(data=5))
    monitor.until(lambda: observed.count == 2)
    assert read == [(5, 1)]
    text = "/other publishes it by another definition of std_msgs/msg/Int64 than is installed here"
    eventually(heard.look, lambda trouble: trouble == text)
    other.node.destroy_publisher(wrong)
    eventually(heard.look, lambda trouble: trouble == "")
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


def test_who_can_t_read_what_is_forwarded_is_told(scene: Scene) -> None:
    monitor, other = scene.peer("monitor"), scene.peer("other")
    define_otherwise(monitor, "other")
    forwarded = republished.MatchedPublisher(monitor.node, msg.Int64, "/n")
    other.record(msg.Int64, "/n")
    text = "/other can't receive /n: it has another definition of std_msgs/msg/Int64 than is installed here"
    eventually(lambda: forwarded.look([]), lambda trouble: trouble == text)
    forwarded.stop()
