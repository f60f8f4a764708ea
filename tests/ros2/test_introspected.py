"""An action that is only observed, by what its server tells of itself, on real ROS 2."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.processes import Data
from tests.ros2.acting import KINDS, SUCCEEDED, acting, hex_of, streams
from tests.ros2.harness import eventually

test_msgs = pytest.importorskip("test_msgs.action")

# rclpy imports an old lark with its first node, and warns by functions of its own that are deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)


def test_an_action_is_observed_by_what_its_server_tells(tmp_path: Path) -> None:
    with acting(tmp_path, streams(via="introspection")) as scene:
        client = scene.observed("introspection")
        goal, rejected, stopped = client.goal(5), client.goal(1000), client.goal(400)
        assert client.result(goal) == (SUCCEEDED, [0, 1, 2, 3, 4])
        client.done(stopped.cancel_goal_async())
        client.result(stopped)
        mine = {hex_of(one) for one in (goal, rejected, stopped)}

        def of(kind: str) -> list[Data]:
            return [event for event in scene.judge.of(kind) if event["goal_id"] in mine]

        eventually(lambda: of("result"), lambda found: len(found) == 2)
        events = [e for e in scene.judge.seen if e["goal_id"] == hex_of(goal)]
        assert {event["kind"] for event in events} == {*KINDS} - {"cancel"}
        by_kind = {e["kind"]: e for e in events}
        assert by_kind["goal"]["data"] == {"order": 5}
        assert (by_kind["reply"]["status"], by_kind["reply"]["call"]) == ("accepted", by_kind["goal"]["call"])
        assert (by_kind["result"]["status"], by_kind["result"]["data"]) == ("succeeded", {"sequence": [0, 1, 2, 3, 4]})
        assert [e["status"] for e in events if e["kind"] == "status"] == ["accepted", "executing", "succeeded"]
        assert [e["status"] for e in of("reply")] == ["accepted", "rejected", "accepted"]
        assert [e["goal_id"] for e in of("cancel")] == [hex_of(stopped)]
        assert hex_of(rejected) in [e["goal_id"] for e in of("goal")]
        assert all(event["stamp"] for event in scene.judge.seen)
        assert not scene.judge.reports.get("/fib goal")
        scene.adapter.ends_well()


def test_without_introspection_feedback_and_status_are_seen_and_the_rest_is_told_to_be_missing(tmp_path: Path) -> None:
    with acting(tmp_path, streams(via="introspection")) as scene:
        client = scene.observed()
        goal = client.goal(5)
        assert client.result(goal)[0] == SUCCEEDED
        ended = (hex_of(goal), "succeeded")
        eventually(lambda: [(e["goal_id"], e["status"]) for e in scene.judge.of("status")], lambda told: ended in told)
        eventually(lambda: scene.judge.of("feedback"), lambda found: len(found) == 5)
        assert {e["kind"] for e in scene.judge.seen} == {"feedback", "status"}
        text = "nobody tells of /fib/_action/send_goal: its server has to turn introspection on"
        eventually(lambda: scene.judge.reports.get("/fib goal", ""), lambda found: text in found)
        scene.adapter.ends_well()


@pytest.mark.parametrize("via", ["introspection", "proxy"])
def test_an_action_that_nobody_serves_is_told(via: str, tmp_path: Path) -> None:
    names = {"name": "/fibs"} | ({"proxy": "/fibs_mon"} if via == "proxy" else {})
    misspelt = [stream | names for stream in streams(via=via, kinds=("goal",))]
    with acting(tmp_path, misspelt) as scene:
        text = "nobody serves /fibs; did you mean /fib?"
        scene.scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", 0.01, 10)
        eventually(lambda: scene.judge.reports.get("/fibs goal", ""), text.__eq__)
        scene.adapter.ends_well()


def test_what_is_told_of_calls_and_can_not_be_read_ends_nothing(tmp_path: Path) -> None:
    with acting(tmp_path, streams(via="introspection")) as scene:
        client = scene.observed("introspection")
        topic, kind = "/fib/_action/send_goal/_service_event", test_msgs.Fibonacci.Impl.SendGoalService.Event
        rubbish = client.peer.publisher(kind, topic)

        def told() -> bool:
            rubbish.publish(b"rubbish")
            trouble = scene.judge.reports.get("/fib goal", "")
            return "what is told of calls of /fib/_action/send_goal can't be read" in trouble

        eventually(told, bool)
        goal = client.goal(5)
        client.result(goal)
        goals = eventually(
            lambda: [e for e in scene.judge.of("goal") if e["goal_id"] == hex_of(goal)], lambda found: found
        )
        assert goals[0]["lost"] >= 1, "the verdicts are degraded by what could not be read"
        eventually(lambda: scene.judge.reports.get("/fib goal", ""), lambda trouble: not trouble)
        scene.adapter.ends_well()
