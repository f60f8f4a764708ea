"""What is made of the numbers of messages, on the distributions that tell them and on those that do not."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest
from oracle_adapter.unread import TOLD_WITHIN, Unread

from tests.processes import PATIENCE
from tests.ros2.harness import Scene, eventually
from tests.ros2.test_qos import EFFORT, profile, pytestmark, scene

__all__ = ["pytestmark", "scene"]
numbering = pytest.importorskip("oracle_ros2.numbering")
serialization = pytest.importorskip("rclpy.serialization")
endpoints = pytest.importorskip("oracle_ros2.endpoints")
standing = pytest.importorskip("oracle_ros2.standing")
msg = pytest.importorskip("std_msgs.msg")
duration = pytest.importorskip("rclpy.duration")


def kilted(publisher: int, number: int) -> dict[str, Any]:
    return jazzy(number) | {"publisher_gid": {"data": bytes([publisher] * 16)}}


def cyclone(publisher: int) -> dict[str, Any]:
    """As of Cyclone DDS: a number of its own, which is nobody's on the graph."""
    return humble() | {"publisher_gid": {"data": bytes([publisher] * 8 + [0] * 8)}, "publication_sequence_number": None}


def jazzy(number: int) -> dict[str, Any]:
    return humble() | {"publication_sequence_number": number, "reception_sequence_number": 7}


def humble() -> dict[str, Any]:
    return {"source_timestamp": 1, "received_timestamp": 2}


def missed(infos: list[dict[str, Any]]) -> list[int]:
    numbers = numbering.Numbers()
    return [numbers.missed(numbering.source_of(info), info) for info in infos]


def test_what_is_lost_or_comes_again_is_seen_by_the_numbers_of_each_publisher() -> None:
    first = [kilted(1, number) for number in (5, 6, 9, 9, 7)]
    assert missed([*first, kilted(2, 1), kilted(2, 2)]) == [0, 0, 2, -1, -1, 0, 0]


def test_a_publisher_that_begins_to_count_anew_is_not_taken_for_one_that_comes_again() -> None:
    def at(published: int, number: int) -> dict[str, Any]:
        return kilted(1, number) | {"source_timestamp": published}

    assert missed([at(10, 5), at(20, 7), at(20, 7), at(10, 5), at(30, 1), at(40, 3), at(30, 1)]) == [
        0, 1, -1, -1, 0, 1, -1,
    ]  # fmt: skip


def test_the_publishers_that_were_heard_last_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over days many come and go."""
    monkeypatch.setattr(numbering, "MOST", 3)
    assert missed([kilted(number % 7, 10 + number) for number in range(50)]) == [0] * 50
    known = [kilted(1, 10), kilted(2, 10), kilted(3, 10), kilted(1, 12)]
    assert missed([*known, kilted(4, 10), kilted(1, 14), kilted(3, 13), kilted(2, 15)]) == [0, 0, 0, 1, 0, 1, 2, 0]


def test_numbers_without_their_publisher_say_nothing() -> None:
    """A node that is started again begins at 1, and two nodes have the same numbers: nothing is old or lost."""
    assert missed([jazzy(number) for number in (499, 500, 1, 2, 2, 40)]) == [0] * 6
    assert missed([humble()] * 3) == [0] * 3


def test_a_number_that_is_nobody_s_on_the_graph_is_no_publisher() -> None:
    assert numbering.source_of(kilted(1, 1)) == "01" * 16
    assert numbering.source_of(cyclone(1)) == numbering.source_of(humble()) == ""


@pytest.mark.parametrize("source", [{}, {"publisher_gid": {"data": bytes([1] * 16)}}])
def test_a_publisher_is_new_once_with_numbers_or_without(source: dict[str, Any]) -> None:
    new: list[str] = []
    numbers = numbering.Numbers(lambda: new.append("new"))
    for _ in range(3):
        numbers.missed(numbering.source_of(source), humble() | source)
    assert new == ["new"]


def test_a_message_that_comes_on_two_subscriptions_is_taken_once_without_numbers(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoints, "is_numbered", lambda _: False)
    peer = scene.peer()
    taken: list[int] = []

    def take(message: bytes, _: Any) -> None:
        taken.append(serialization.deserialize_message(message, msg.Int64).data)

    heard = endpoints.MatchedSubscription(peer.node, msg.Int64, "/here", take)
    steady = peer.publisher(msg.Int64, "/here")
    effort = peer.publisher(msg.Int64, "/here", qos=profile(EFFORT), listeners=0)
    heard.look()
    old, new = peer.node.subscriptions
    eventually(lambda: (steady.get_subscription_count(), effort.get_subscription_count()), lambda c: c == (2, 1))
    for number in range(10):
        steady.publish(msg.Int64(data=number))
    assert steady.wait_for_all_acked(duration.Duration(seconds=PATIENCE))

    def turn() -> Any:
        with new.handle:
            found = new.handle.take_message(msg.Int64, True)
        return found and new.callback(*found) is None

    eventually(turn, bool)
    eventually(lambda: heard.take_all() or taken[-1:], lambda last: last == [9])
    for one in (old, new):
        with one.handle:
            assert one.handle.take_message(msg.Int64, True) is None
    assert taken == [*range(10)]
    heard.stop()


def test_status_arrays_that_are_lost_count_also_where_the_next_one_says_nothing_new(scene: Scene) -> None:
    """Who did not see a goal end, and start to end otherwise, must not take what follows for all there was."""
    sent: list[tuple[str, int]] = []
    link = SimpleNamespace(send=lambda *_, status, lost, **__: sent.append((status, lost)))
    shared = SimpleNamespace(node=scene.peer().node, link=link)
    stream = standing.StatusStream(shared, {"name": "/dock", "kind": "status", "latency": 0})
    info, goal = kilted(1, 1) | {"source_timestamp": 2**62}, b"a" * 16
    stream.take({goal: 1}, info, 0)
    stream.take({goal: 1}, info, 2)
    stream.take({goal: 2}, info, 1)
    stream.unread.add(1)
    stream.take({goal: 4}, info, 0)
    stream.take({goal: 2}, info, 0)
    assert sent == [("accepted", 0), ("executing", 3), ("succeeded", 1), ("executing", 0)]


def test_what_an_action_tells_first_is_not_taken_for_kept_after_the_clock_was_set_back(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an action's server that was started then the first goals were not told."""
    sent: list[str] = []
    shared = SimpleNamespace(
        node=scene.peer().node, link=SimpleNamespace(send=lambda *_, status, **__: sent.append(status))
    )
    now = time.time_ns
    with monkeypatch.context() as ahead:
        ahead.setattr(time, "time_ns", lambda: now() + 1800 * 10**9)
        stream = standing.StatusStream(shared, {"name": "/dock", "kind": "status", "latency": 0})
    kept, begun = now() - 10**9, now() + 10**9
    stream.take({b"a" * 16: 2}, kilted(1, 1) | {"source_timestamp": kept}, 0)
    stream.take({b"b" * 16: 1}, kilted(2, 1) | {"source_timestamp": begun}, 0)
    assert sent == ["accepted"]


def test_status_arrays_that_are_lost_are_told_by_another_event_where_none_of_their_stream_follows(scene: Scene) -> None:
    now, told = 5.0, list[int]()
    shared = SimpleNamespace(node=scene.peer().node, link=SimpleNamespace(lost=told.append))
    stream = standing.StatusStream(shared, {"name": "/dock", "kind": "status", "latency": 0})
    stream.unread = Unread(lambda: now)
    stream.unread.add(2)
    stream.keep([])
    now += TOLD_WITHIN
    stream.keep([])
    stream.keep([])
    assert told == [0, 2, 0]
