"""In which order the news of one goal are told, to its client and to the oracle, on real ROS 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.ros2.acting import (
    ABORTED,
    DENIED,
    KINDS,
    SUCCEEDED,
    Client,
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
EXECUTING = 2
LASTING = qos.qos_profile_action_status_default


class Wire:
    """What the proxy sends of feedback and of one result, with the times (ns) at which it did."""

    def __init__(self, client: Client) -> None:
        self._client, self._impl = client, test_msgs.Fibonacci.Impl
        node = client.peer.node
        self.feedback: list[tuple[int, int]] = []
        node.create_subscription(self._impl.FeedbackMessage, "/fib_mon/_action/feedback", self._hear, 1000)
        self._results = node.create_client(self._impl.GetResultService, "/fib_mon/_action/get_result")
        client.peer.until(self._results.service_is_ready)
        self._answer: tuple[int, Any] | None = None

    def _hear(self, message: Any, info: Any) -> None:
        self.feedback.append((info["source_timestamp"], message.feedback.sequence[0]))

    def ask(self, goal: Any) -> None:
        """Ask for a goal's result."""
        with self._results.handle:
            self._results.handle.send_request(self._impl.GetResultService.Request(goal_id=goal.goal_id))

    def came(self) -> bool:
        """Whether the result has come."""
        with self._results.handle:
            header, response = self._results.handle.take_response(self._impl.GetResultService.Response)
        if header is not None:
            self._answer = header.source_timestamp, response
        return self._answer is not None

    def result(self) -> tuple[int, Any]:
        self._client.peer.until(self.came, "there is no result")
        assert self._answer is not None
        return self._answer


@pytest.mark.parametrize("asked", [("feedback",), ("feedback", "result")])
@pytest.mark.parametrize("denied", [False, True])
def test_a_result_comes_behind_the_feedback_that_came_before_it(
    asked: tuple[str, ...], denied: bool, tmp_path: Path
) -> None:
    with acting(tmp_path, streams(*asked, decide_within=3600 * 10**9), "tests.ros2.patient") as scene:
        server, client = scene.server(), scene.client()
        client.meet()
        wire = Wire(client)
        scene.judge.denies = lambda event: denied and (event["kind"] == "result" or event["data"]["sequence"] == [29])
        scene.judge.waits = lambda event: event["kind"] == "feedback"
        goal = client.goal(30)
        wire.ask(goal)
        server.said("ended 30")
        mine = hex_of(goal)
        eventually(lambda: [e for e in scene.judge.of("result") if e["goal_id"] == mine], bool)
        assert client.goal(0).accepted, "and whatever else passes"
        assert not wire.came()
        scene.judge.release()
        at, response = wire.result()
        wanted = list(range(29 if denied else 30))
        client.peer.until(lambda: len(wire.feedback) == len(wanted))
        assert [number for _, number in wire.feedback] == wanted
        assert max(when for when, _ in wire.feedback) <= at
        assert response.status == (ABORTED if denied and "result" in asked else SUCCEEDED)
        scene.adapter.ends_well()


def test_a_result_does_not_wait_for_ever(tmp_path: Path) -> None:
    with acting(tmp_path, streams("feedback", decide_within=3600 * 10**9)) as scene:
        scene.server()
        client = scene.client()
        client.meet()
        scene.judge.waits = lambda event: event["kind"] == "feedback"
        goal = client.goal(3)
        assert client.result(goal) == (SUCCEEDED, [0, 1, 2])
        assert hex_of(goal) not in client.heard
        scene.adapter.ends_well()


def test_results_that_wait_are_given_when_the_monitor_ends(tmp_path: Path) -> None:
    with acting(tmp_path, streams("feedback", decide_within=3600 * 10**9), "tests.ros2.patient") as scene:
        server, client = scene.server(), scene.client()
        client.meet()
        scene.judge.waits = lambda event: event["kind"] == "feedback"
        goal = client.goal(3)
        result = goal.get_result_async()
        server.said("ended 3")
        eventually(lambda: [e for e in scene.judge.of("result") if e["goal_id"] == hex_of(goal)], bool)
        scene.adapter.ends_well()
        assert client.done(result).status == SUCCEEDED


def test_what_is_reported_of_a_goal_has_times_in_the_order_in_which_it_is_told(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal", latency=3600 * 10**9)) as scene:
        scene.server()
        client = scene.client()
        client.meet()
        goals = [client.goal(5) for _ in range(10)]
        assert [client.result(goal)[0] for goal in goals] == [SUCCEEDED] * 10
        for goal in goals:
            mine = hex_of(goal)
            eventually(
                lambda mine=mine: [e.get("status") for e in scene.judge.of("status") if e["goal_id"] == mine],
                lambda told: told[-1:] == ["succeeded"],
            )
            events = [event for event in scene.judge.seen if event["goal_id"] == mine]
            stamps = [event["stamp"] for event in events]
            assert stamps == sorted(stamps)
            assert [event["kind"] for event in events][:2] == ["goal", "reply"]
            numbers = [e["data"]["sequence"] for e in events if e["kind"] == "feedback"]
            assert numbers == [[n] for n in range(5)]
        clocks = scene.judge.clocks
        assert {kind for _, kind in clocks} >= {*KINDS}
        assert min(clocks.values()) > stamps[0], "the clocks of all kinds are exact, and nothing waits for them"
        scene.adapter.ends_well()


def told_of(client: Client) -> dict[str, list[int]]:
    """The statuses that a client is told of each goal, as they come."""
    told: dict[str, list[int]] = {}

    def take(array: Any) -> None:
        for one in array.status_list:
            told.setdefault(bytes(one.goal_info.goal_id.uuid).hex(), []).append(one.status)

    client.peer.node.create_subscription(action_msgs.GoalStatusArray, "/fib_mon/_action/status", take, LASTING)
    return told


def test_no_status_tells_of_an_end_while_the_result_is_decided_on(tmp_path: Path) -> None:
    with acting(tmp_path, streams("result", decide_within=3600 * 10**9)) as scene:
        scene.server()
        client = scene.client()
        told = told_of(client)
        client.meet()
        scene.judge.waits = lambda event: event["kind"] == "result"
        goal = client.goal(1)
        result = goal.get_result_async()
        eventually(lambda: [e for e in scene.judge.of("result") if e["goal_id"] == hex_of(goal)], bool)
        other = client.goal(400)
        client.peer.until(lambda: EXECUTING in told.get(hex_of(other), []))
        client.peer.until(lambda: hex_of(goal) in told)
        assert SUCCEEDED not in told[hex_of(goal)]
        scene.judge.denies = lambda _: True
        scene.judge.release()
        assert (client.done(result).status, list(result.result().result.sequence)) == (ABORTED, DENIED["sequence"])
        client.peer.until(lambda: told[hex_of(goal)][-1] == ABORTED)
        assert SUCCEEDED not in told[hex_of(goal)]
        scene.adapter.ends_well()


def test_no_status_tells_of_an_end_before_the_result_is_asked_for(tmp_path: Path) -> None:
    with acting(tmp_path, streams("result"), "tests.ros2.patient") as scene:
        server, client = scene.server(), scene.client()
        told = told_of(client)
        client.meet()
        goal = client.goal(2)
        server.said("ended 2")
        other = client.goal(3)
        client.peer.until(lambda: EXECUTING in told.get(hex_of(other), []))
        assert SUCCEEDED not in told.get(hex_of(goal), [])
        scene.judge.denies = lambda event: event["goal_id"] == hex_of(goal)
        assert client.result(goal) == (ABORTED, DENIED["sequence"])
        assert client.result(other)[0] == SUCCEEDED
        client.peer.until(lambda: told[hex_of(goal)][-1] == ABORTED and told[hex_of(other)][-1] == SUCCEEDED)
        assert SUCCEEDED not in told[hex_of(goal)]
        scene.adapter.ends_well()


def test_an_end_is_told_though_nobody_asks_for_its_result_and_is_not_taken_back(tmp_path: Path) -> None:
    with acting(tmp_path, streams("result")) as scene:
        scene.server()
        client = scene.client()
        told = told_of(client)
        client.meet()
        goal = client.goal(1)
        client.peer.until(lambda: SUCCEEDED in told.get(hex_of(goal), []), "it is never told")
        scene.judge.denies = lambda _: True
        assert client.result(goal) == (ABORTED, DENIED["sequence"])
        client.peer.until(lambda: told[hex_of(goal)][-1] == ABORTED)
        assert EXECUTING not in told[hex_of(goal)][told[hex_of(goal)].index(SUCCEEDED) :]
        scene.adapter.ends_well()
