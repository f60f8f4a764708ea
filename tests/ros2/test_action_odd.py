"""Clients of an action on real ROS 2 that do what rclpy's don't, and more than one monitor of it."""

from __future__ import annotations

import itertools
import signal
from pathlib import Path
from typing import Any

import pytest
from oracle_ros2 import relay

from tests.adapters.judge import judge
from tests.processes import Data
from tests.ros2.acting import (
    ABORTED,
    DENIED,
    SUCCEEDED,
    UNKNOWN,
    Acting,
    acting,
    action_msgs,
    hex_of,
    qos,
    streams,
    test_msgs,
)
from tests.ros2.harness import eventually

# rclpy imports an old lark with its first node, and warns by functions of its own that are deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)
IMPL = test_msgs.Fibonacci.Impl
ZERO, ONE = bytes(16), bytes(range(16))
LONG = 100
"""An order that takes a second: its result is asked for long before it expires, a second after its end."""


class Raw:
    """A client that calls the hidden services itself, by the ids that it likes."""

    def __init__(self, scene: Acting, name: str = "/fib_mon") -> None:
        self.peer = scene.scene.peer()
        node = self.peer.node
        self.feedback: list[tuple[bytes, int]] = []
        node.create_subscription(IMPL.FeedbackMessage, f"{name}/_action/feedback", self._hear, 1000)
        self.told: list[tuple[bytes, int]] = []
        node.create_subscription(
            action_msgs.GoalStatusArray, f"{name}/_action/status", self._see, qos.qos_profile_action_status_default
        )
        many = qos.QoSProfile(depth=100 * relay.MOST)  # else later answers take the place of the first one's
        self._goals = node.create_client(IMPL.SendGoalService, f"{name}/_action/send_goal", qos_profile=many)
        self._results = node.create_client(IMPL.GetResultService, f"{name}/_action/get_result", qos_profile=many)
        self.peer.until(lambda: self._goals.service_is_ready() and self._results.service_is_ready())

    def send(self, goal: bytes, order: int) -> Any:
        """A goal that is on its way."""
        request = IMPL.SendGoalService.Request(goal=test_msgs.Fibonacci.Goal(order=order))
        request.goal_id.uuid = list(goal)
        return self._goals.call_async(request)

    def accepted(self, goal: bytes, order: int) -> bool:
        sent = self.send(goal, order)
        self.peer.until(sent.done, "there is no reply")
        return bool(sent.result().accepted)

    def ask_result(self, goal: bytes) -> Any:
        """A question for a result that is on its way."""
        request = IMPL.GetResultService.Request()
        request.goal_id.uuid = list(goal)
        return self._results.call_async(request)

    def result(self, goal: bytes) -> tuple[int, list[int]]:
        asked = self.ask_result(goal)
        self.peer.until(asked.done, "there is no result")
        return asked.result().status, list(asked.result().result.sequence)

    def _hear(self, message: Any) -> None:
        self.feedback.append((bytes(message.goal_id.uuid), message.feedback.sequence[0]))

    def _see(self, array: Any) -> None:
        self.told += [(bytes(one.goal_info.goal_id.uuid), one.status) for one in array.status_list]


def expire(scene: Acting, goal: bytes) -> None:
    """Wait until the server has forgotten a goal.

    A goal with the id of one that it is about to forget it may take, and forget with that one (rclpy takes what has
    expired in one thread, and lets go of it in another).
    """
    direct = Raw(scene, "/fib")
    direct.peer.until(lambda: direct.result(goal)[0] == UNKNOWN, "the id never expires")


@pytest.mark.parametrize("goal", [ZERO, ONE])
def test_an_id_that_is_used_again_is_that_of_another_goal(goal: bytes, tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal", "reply", "result")) as scene:
        server = scene.server(0.01, 1)
        client = Raw(scene)
        scene.judge.denies = lambda event: event["kind"] == "result" or event["data"] == {"order": 7}
        assert not client.accepted(goal, 7)
        assert client.accepted(goal, 400)
        assert not client.accepted(goal, 5), "the first one goes on"
        assert not client.accepted(goal, 7)
        assert client.accepted(ONE[::-1], 2)
        assert client.result(ONE[::-1]) == (ABORTED, DENIED["sequence"])
        assert client.result(goal) == (ABORTED, DENIED["sequence"])
        server.said("ended 400")
        scene.judge.denies = lambda _: False
        expire(scene, goal)
        assert client.accepted(goal, LONG)
        assert client.result(goal) == (SUCCEEDED, list(range(LONG)))
        client.peer.until(lambda: (goal, SUCCEEDED) in client.told, "its end is not shown")
        scene.adapter.ends_well()


def test_an_id_that_was_refused_may_be_used_again(tmp_path: Path) -> None:
    with acting(tmp_path, streams("reply")) as scene:
        server = scene.server(0.01, 1)
        client = Raw(scene)
        scene.judge.denies = lambda event: event["status"] == "accepted"
        assert not client.accepted(ONE, 400)
        server.said("cancelled 400")
        scene.judge.denies = lambda _: False
        expire(scene, ONE)
        assert client.accepted(ONE, LONG)
        assert client.result(ONE) == (SUCCEEDED, list(range(LONG)))
        client.peer.until(lambda: [number for goal, number in client.feedback if goal == ONE] == list(range(LONG)))
        client.peer.until(lambda: (ONE, SUCCEEDED) in client.told, "its end is not shown")
        scene.adapter.ends_well()


def test_results_of_goals_that_nobody_has_sent_are_unknown(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal", "result")) as scene:
        scene.server()
        client = Raw(scene)
        client.peer.until(lambda: client.result(ONE)[0] == UNKNOWN)
        scene.adapter.ends_well()


def test_of_results_that_are_asked_for_and_do_not_come_the_oldest_is_unknown(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal", "result")) as scene:
        scene.server(10.0)
        client = Raw(scene)
        assert client.accepted(ONE, LONG)
        first, *_ = [client.ask_result(ONE) for _ in range(relay.MOST)]
        client.peer.until(lambda: client.ask_result(ONE) and first.done())
        assert first.result().status == UNKNOWN
        scene.adapter.said(f"/fib has not told the result of goal {ONE.hex()}, nor 1000 that were asked for later")
        scene.adapter.ends_well()


def test_of_goals_that_their_server_does_not_answer_the_oldest_is_rejected(tmp_path: Path) -> None:
    with acting(tmp_path, streams()) as scene:
        server = scene.server(10.0)
        client = Raw(scene)
        assert client.accepted(ZERO, 0)
        server.send(signal.SIGSTOP)
        first, *_ = [client.send(goal.to_bytes(16, "big"), LONG) for goal in range(1, relay.MOST + 1)]
        later = itertools.count(relay.MOST + 1)
        client.peer.until(lambda: client.send(next(later).to_bytes(16, "big"), LONG) and first.done())
        assert not first.result().accepted
        oldest = (1).to_bytes(16, "big").hex()
        scene.adapter.said(f"/fib has not answered goal {oldest}, nor 1000 that came later: it is rejected")
        scene.adapter.ends_well()


def test_two_monitors_watch_one_action_one_behind_the_other(tmp_path: Path) -> None:
    behind = [{**one, "name": "/fib_mon", "proxy": "/fib_mon_mon"} for one in streams("goal", "result")]
    with judge(behind) as second, acting(tmp_path, streams("goal", "result")) as scene:
        other = scene.monitor("uav2", second)
        scene.server()
        client = scene.client("/fib_mon_mon")
        client.meet()
        goal = client.goal(3)
        assert client.result(goal) == (SUCCEEDED, [0, 1, 2])
        for judged in (scene.judge, second):
            assert of_goal(judged.of("goal", "result"), goal) == ["goal", "result"]
        second.denies = lambda event: event["kind"] == "goal"
        assert not client.goal(4).accepted
        assert {"order": 4} not in [event["data"] for event in scene.judge.of("goal")]
        scene.adapter.ends_well()
        other.ends_well()


def test_two_monitors_beside_each_other_tell_of_each_other(tmp_path: Path) -> None:
    beside = [{**one, "proxy": "/fib_2"} for one in streams("goal")]
    with judge(beside) as second, acting(tmp_path, streams("goal")) as scene:
        other = scene.monitor("uav2", second)
        scene.server()
        for name, judged in (("/fib_mon", scene.judge), ("/fib_2", second)):
            client = scene.client(name)
            client.meet()
            goal = client.goal(3)
            assert client.result(goal) == (SUCCEEDED, [0, 1, 2])
            assert of_goal(judged.of("goal"), goal) == ["goal"]
        for judged, node in ((scene.judge, "/uav2"), (second, "/uav1")):
            text = f"{node} can call /fib/_action/send_goal past the monitor"
            eventually(
                lambda judged=judged: judged.reports.get("/fib goal", ""), lambda found, text=text: text in found
            )
        scene.adapter.ends_well()
        other.ends_well()


def of_goal(events: list[Data], goal: Any) -> list[str]:
    return [event["kind"] for event in events if event["goal_id"] == hex_of(goal)]
