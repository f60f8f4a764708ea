"""What lasts and is forwarded on real ROS 2: who comes later hears the last message of each publisher."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.processes import PATIENCE
from tests.robot import spec_folder
from tests.ros2.harness import Peer, Scene

republished = pytest.importorskip("oracle_ros2.republished")
rclpy_qos = pytest.importorskip("rclpy.qos")
msg = pytest.importorskip("std_msgs.msg")
Duration = pytest.importorskip("rclpy.duration").Duration

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

SPEC = """
id: maps
description: Numbers pass, but for multiples of 7
streams:
  - topic: /map
    type: std_msgs/msg/Int64
    action: filter
    intercept: publisher
    decide_within: 60s
    signals: {seven: msg.data % 7 == 0}
properties:
  - id: no_sevens
    formula: 'not {topic: "/map", seven}'
    guards: [/map]
"""
LASTING = rclpy_qos.DurabilityPolicy.TRANSIENT_LOCAL


def kept(depth: int) -> Any:
    return rclpy_qos.QoSProfile(depth=depth, durability=LASTING)


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        scene.adapter("maps")
        yield scene


def publisher(peer: Peer) -> Callable[[int], None]:
    """What publishes a number on a lasting topic, of which the last one is kept."""
    made = peer.publisher(msg.Int64, "/map_mon", qos=kept(1))
    return lambda number: made.publish(msg.Int64(data=number))


def heard_late(peer: Peer, wanted: list[int]) -> None:
    """Those who come now hear just that, in whatever order."""
    heard = peer.record(msg.Int64, "/map", kept(100))
    peer.until(lambda: len(heard) >= len(wanted), f"of {wanted} only {heard} is kept")
    assert sorted(said.data for said in heard) == wanted


def test_what_a_publisher_has_said_once_is_kept_when_others_come_speak_and_go(scene: Scene) -> None:
    peer, other = scene.peer(), scene.peer("other")
    early = peer.record(msg.Int64, "/map", kept(100))

    def settled(count: int) -> None:
        """Until so many publishers forward it."""
        peer.until(lambda: peer.node.count_publishers("/map") == count, f"not {count} publishers forward it")

    publisher(peer)(1)
    peer.until(lambda: early, "it does not pass")
    say = publisher(other)
    settled(2)
    heard_late(peer, [1])
    for number in (2, 3):
        say(number)
    peer.until(lambda: len(early) == 3, "they do not pass")
    heard_late(peer, [1, 3])
    other.node.destroy_publisher(next(made for made in other.node.publishers if made.topic_name == "/map_mon"))
    settled(1)
    heard_late(peer, [1])
    assert [said.data for said in early] == [1, 2, 3]


def test_several_that_publish_at_once_as_they_come_are_all_kept(scene: Scene) -> None:
    peer = scene.peer()
    early = peer.record(msg.Int64, "/map", kept(100))
    for number in (1, 2, 3):
        publisher(scene.peer(f"source{number}"))(number)
    peer.until(lambda: len(early) == 3, "they do not pass")
    heard_late(peer, [1, 2, 3])


def test_where_the_middleware_tells_of_no_publishers_as_many_messages_are_kept_as_there_are(tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        peer = scene.peer()
        forwarded = republished.MatchedPublisher(peer.node, msg.Int64, "/map", [kept(1)])

        def offer(count: int, sources: list[str]) -> None:
            """Until as many messages are kept, for those sources."""

            def offered() -> bool:
                forwarded.look([kept(1)] * len(sources), sources)
                return [made.qos_profile.depth for made in peer.node.publishers if made.topic_name == "/map"] == [count]

            peer.until(offered, f"not {count} are kept")

        forwarded.is_told = False
        forwarded.publish(msg.Int64(data=1))
        offer(2, ["a", "b"])
        forwarded.publish(msg.Int64(data=2))
        offer(2, ["a"])
        heard_late(peer, [1, 2])
        forwarded.stop()


def test_what_several_publish_as_they_come_is_kept_and_passes_once_where_they_are_not_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(republished, "GROWING", PATIENCE)
    with Scene(tmp_path) as scene:
        peer, robot = scene.peer(), scene.peer("robot")
        early = robot.record(msg.Int64, "/map", kept(100))
        forwarded = republished.MatchedPublisher(peer.node, msg.Int64, "/map")
        forwarded.is_told = False
        forwarded.match([kept(1)], ["a"])
        for number in (1, 2, 3):
            forwarded.publish(msg.Int64(data=number))

        def passed() -> bool:
            forwarded.look([kept(1)] * 3, ["a", "b", "c"])
            return len(early) >= 3

        robot.until(passed, "they do not pass")
        heard_late(robot, [1, 2, 3])
        assert [said.data for said in early] == [1, 2, 3]
        forwarded.stop()


def test_who_publishes_already_is_not_held_up_by_those_who_come(tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        peer, robot = scene.peer(), scene.peer("robot")
        heard = robot.record(msg.Int64, "/map", kept(100))
        forwarded = republished.MatchedPublisher(peer.node, msg.Int64, "/map", [kept(1)])
        forwarded.publish(msg.Int64(data=1), "a")
        robot.until(lambda: heard, "it does not pass")
        forwarded.match([kept(1)] * 2, ["a", "b"])
        forwarded.publish(msg.Int64(data=2), "b")
        forwarded.publish(msg.Int64(data=3), "a")
        robot.until(lambda: len(heard) == 2, "it waits for the publisher of another one")
        assert heard[-1].data == 3

        def passed() -> bool:
            forwarded.look([kept(1)] * 2, ["a", "b"])
            return len(heard) == 3

        robot.until(passed, "what was held does not pass")
        forwarded.stop()


def test_what_is_given_again_ends_with_what_was_said_last(tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        peer, robot = scene.peer(), scene.peer("robot")
        heard = robot.record(msg.Int64, "/map", kept(100))
        forwarded = republished.MatchedPublisher(peer.node, msg.Int64, "/map", [kept(1)])

        def offered(originals: list[Any]) -> list[Any]:
            forwarded.look(originals, ["a", "b"])
            return [made.qos_profile.deadline for made in peer.node.publishers if made.topic_name == "/map"]

        def say(number: int, source: str) -> None:
            forwarded.publish(msg.Int64(data=number), source)
            robot.until(lambda: offered([kept(1)] * 2) and len(heard) == number, "it does not pass")

        robot.until(lambda: len(offered([kept(1)] * 2)) == 2, "there is one publisher")
        for number, source in ((1, "a"), (2, "b"), (3, "a")):
            say(number, source)
        promising = rclpy_qos.QoSProfile(depth=1, durability=LASTING, deadline=Duration(seconds=60))
        robot.until(lambda: {d.nanoseconds for d in offered([promising] * 2)} == {60 * 10**9}, "nothing is promised")
        robot.until(lambda: len(heard) == 5, "it is not given again")
        assert [said.data for said in heard] == [1, 2, 3, 2, 3]
        forwarded.stop()


@pytest.mark.parametrize("others", [[], ["b"]])  # "b": started again, before it has said anything
def test_what_a_publisher_has_kept_goes_with_it_and_is_there_again_where_it_comes_back(
    others: list[str], tmp_path: Path
) -> None:
    with Scene(tmp_path) as scene:
        peer, robot = scene.peer(), scene.peer("robot")
        forwarded = republished.MatchedPublisher(peer.node, msg.Int64, "/map", [kept(1)])

        def publishers(count: int, sources: list[str]) -> list[Any]:
            """Those that forward it once they are as many as these sources need, and nothing changes any more."""
            made: list[Any] = []

            def settled() -> bool:
                before, made[:] = list(made), (one for one in peer.node.publishers if one.topic_name == "/map")
                forwarded.look([kept(1)] * len(sources), sources)
                return len(made) == count and made == before

            peer.until(settled, f"not {count} publishers forward it")
            return list(made)

        publishers(1, ["a"])
        forwarded.publish(msg.Int64(data=1), "a")
        first = publishers(1, ["a"])
        peer.until(lambda: publishers(1, others) != first, "it is kept on")
        heard = robot.record(msg.Int64, "/map", kept(100))
        robot.until(lambda: robot.node.count_publishers("/map") == 1 and forwarded_to(peer), "not connected")
        forwarded.publish(msg.Int64(data=2), "b")
        robot.until(lambda: heard, "it does not pass")
        assert [said.data for said in heard] == [2]
        robot.until(lambda: publishers(2, ["b", "a"]) and len(heard) == 2, "what is back is not given")
        heard_late(robot, [1, 2])
        forwarded.stop()


def forwarded_to(peer: Peer) -> bool:
    """Whether somebody is connected to what is forwarded."""
    return any(one.get_subscription_count() for one in peer.node.publishers if one.topic_name == "/map")
