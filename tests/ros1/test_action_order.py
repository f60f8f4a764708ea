"""In which order the news of one goal are told, to its client and to the oracle, on real ROS 1."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest
from actionlib import msg
from actionlib_msgs.msg import GoalStatus

from tests.processes import Data
from tests.ros1.actionscene import KINDS, client, count, ids, server, streams, watched

LONG = 3600 * 10**9
"""As long as a decision may take (ns)."""


@pytest.mark.parametrize("ask", ["feedback", "feedback result"])
@pytest.mark.parametrize("denied", [False, True])
def test_a_result_comes_behind_the_feedback_that_came_before_it(ask: str, denied: bool, tmp_path: Path) -> None:
    waits = [True]

    def decide(event: Data) -> str | Literal[False] | None:
        if event["kind"] == "feedback":
            return False if waits else None
        return "rule" if denied and event["data"]["result"] else None

    described = streams("feedback", "result", ask=ask, decide_within=LONG)
    with watched(tmp_path, described, decide, "tests.ros1.patient") as (scene, oracle, process):
        server(scene, count)
        peer, ear = client(scene), scene.peer()
        ear.record(msg.TestActionFeedback, "/count_mon/feedback", speakers=1)
        ear.record(msg.TestActionResult, "/count_mon/result", speakers=1)
        goal, goal_id = peer.send_goal("/count_mon", msg.TestGoal(30))
        oracle.heard("feedback", 30)
        oracle.heard("result", 1)
        other, other_id = peer.send_goal("/count_mon", msg.TestGoal(0))
        assert peer.ended(other) is not None
        assert [said.status.goal_id.id for said in ear.heard("/count_mon/result", 1)] == [other_id]
        assert ear.heard("/count_mon/feedback") == []
        waits.clear()
        oracle.allow("feedback")
        ended = peer.ended(goal)
        assert ended is not None
        aborted = denied and "result" in ask
        assert ended.status == (GoalStatus.ABORTED if aborted else GoalStatus.SUCCEEDED)
        assert [said.feedback.feedback for said in ear.heard("/count_mon/feedback", 30)] == list(range(1, 31))
        assert [said.status.goal_id.id for said in ear.heard("/count_mon/result", 2)] == [other_id, goal_id]
        process.ends_well()


def test_a_result_does_not_wait_for_ever(tmp_path: Path) -> None:
    described = streams("feedback", "result", ask="feedback", decide_within=LONG)
    with watched(tmp_path, described, lambda _: False) as (scene, _, process):
        server(scene, count)
        peer = client(scene)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(3))
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.feedback) == (GoalStatus.SUCCEEDED, [])
        process.ends_well()


def test_what_is_reported_of_a_goal_has_times_in_the_order_in_which_it_is_told(tmp_path: Path) -> None:
    with watched(tmp_path, streams(*KINDS, ask="goal")) as (scene, oracle, process):
        server(scene, count)
        peer = client(scene)
        goals = [peer.send_goal("/count_mon", msg.TestGoal(5)) for _ in range(5)]
        for goal, _ in goals:
            peer.ended(goal)
        oracle.heard("result", 5)
        oracle.heard("feedback", 25)
        assert set(ids(oracle.heard("reply", 5))) == {goal_id for _, goal_id in goals}
        for _, goal_id in goals:
            events = [event for event in oracle.heard() if event["goal_id"] == goal_id]
            stamps = [event["stamp"] for event in events]
            assert stamps == sorted(stamps)
            assert [event["kind"] for event in events if event["kind"] != "status"][:2] == ["goal", "reply"]
        process.ends_well()
