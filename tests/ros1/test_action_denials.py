"""What ends goals on real ROS 1 but their server: what the oracle denies, and cancels."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from actionlib import msg
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from rospy import AnyMsg

from tests.processes import Data, eventually
from tests.ros1.actionscene import KINDS, client, count, hesitate, ids, last, refuse, server, streams, watched

# What is denied


def test_a_denied_goal_is_rejected_and_the_server_never_hears_of_it(tmp_path: Path) -> None:
    def no_sevens(event: Data) -> str | None:
        return "no_sevens" if event["data"] == {"goal": 7} else None

    with watched(tmp_path, streams("goal", "reply", "status", ask="goal"), no_sevens) as (scene, oracle, process):
        serving, ear = server(scene, count), scene.peer()
        peer = client(scene)
        ear.record(GoalStatusArray, "/count_mon/status", speakers=1)
        denied, denied_id = peer.send_goal("/count_mon", msg.TestGoal(7))
        ended = peer.ended(denied)
        assert ended is not None
        assert (ended.status, ended.text) == (GoalStatus.REJECTED, "denied: no_sevens")
        passed, passed_id = peer.send_goal("/count_mon", msg.TestGoal(2))
        ended = peer.ended(passed)
        assert ended is not None
        assert ended.status == GoalStatus.SUCCEEDED
        assert serving.goals("/count") == [passed_id]

        def shown() -> list[tuple[int, str]]:
            arrays = ear.heard("/count_mon/status")
            return [(s.status, s.text) for array in arrays for s in array.status_list if s.goal_id.id == denied_id]

        ear.until(shown, lambda: "it is in no status")
        assert set(shown()) == {(GoalStatus.REJECTED, "denied: no_sevens")}
        ear.until(  # it is over soon
            lambda: denied_id not in [s.goal_id.id for s in ear.heard("/count_mon/status")[-1].status_list],
            lambda: "it stays",
        )
        [goal, _] = oracle.heard("goal", 2)
        assert not oracle.passed(goal)
        assert denied_id not in ids([*oracle.heard("reply"), *oracle.heard("status")])
        process.said(f"denied a goal of /count, goal {denied_id}: no_sevens")
        process.ends_well()


def test_a_denied_goal_stands_among_the_servers_byte_for_byte_until_it_has_expired(tmp_path: Path) -> None:
    def no_sevens(event: Data) -> str | None:
        return "no_sevens" if event["data"] == {"goal": 7} else None

    with watched(tmp_path, streams("goal", ask="goal"), no_sevens) as (scene, _, process):
        server(scene, last)
        peer, early, late = client(scene), scene.peer(), scene.peer()
        early.record(AnyMsg, "/count/status", speakers=1)
        running, running_id = peer.send_goal("/count_mon", msg.TestGoal(1))
        peer.fed(running, 1)
        denied, denied_id = peer.send_goal("/count_mon", msg.TestGoal(7))
        assert peer.ended(denied) is not None
        late.record(AnyMsg, "/count_mon/status", speakers=1)

        def of_server() -> list[bytes]:
            return [array._buff for array in early.heard("/count/status")]

        def told() -> list[bytes]:
            return [array._buff for array in late.heard("/count_mon/status")]

        def standing(array: bytes) -> dict[str, int]:
            return {s.goal_id.id: s.status for s in GoalStatusArray().deserialize(array).status_list}

        late.until(lambda: len(told()) > 1 and denied_id not in standing(told()[-1]), lambda: "it does not expire")
        assert standing(told()[0]) == {running_id: GoalStatus.ACTIVE, denied_id: GoalStatus.REJECTED}, "it comes late"
        with_it = [array for array in told() if denied_id in standing(array)]
        without = told()[len(with_it) :]
        assert not any(denied_id in standing(array) for array in without)
        early.until(lambda: set(without) <= set(of_server()), lambda: "something else was made of them")
        before_the_count = len(without[0]) - len(entries(without[0])) - 4
        assert all(entries(array).startswith(entries(without[0])) for array in with_it)
        assert {array[:before_the_count] for array in with_it} <= {array[:before_the_count] for array in of_server()}
        process.ends_well()


def entries(array: bytes) -> bytes:
    """The entries of a serialized array, without what stands before them."""
    written = io.BytesIO()
    for entry in GoalStatusArray().deserialize(array).status_list:
        entry.serialize(written)
    return written.getvalue()


def test_denied_feedback_does_not_pass_and_the_rest_does(tmp_path: Path) -> None:
    def even(event: Data) -> str | None:
        return None if event["data"]["feedback"] % 2 == 0 else "even"

    with watched(tmp_path, streams("feedback", ask="feedback"), even) as (scene, oracle, process):
        server(scene, count)
        peer, ear = client(scene), scene.peer()
        ear.record(msg.TestActionFeedback, "/count_mon/feedback", speakers=1)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(50))
        peer.ended(goal)
        passed = [said.feedback.feedback for said in ear.heard("/count_mon/feedback", 25)]
        assert passed == list(range(2, 51, 2))
        assert len(oracle.heard("feedback", 50)) == 50
        process.ends_well()


def test_a_denied_result_is_aborted_with_what_the_spec_gives_and_no_status_says_otherwise(tmp_path: Path) -> None:
    with watched(tmp_path, streams("result", "status", ask="result"), lambda _: "true") as (scene, oracle, process):
        server(scene, count)
        ear, peer = scene.peer(), client(scene)
        ear.record(GoalStatusArray, "/count_mon/status", speakers=1)
        ear.record(msg.TestActionResult, "/count_mon/result", speakers=1)
        goal, goal_id = peer.send_goal("/count_mon", msg.TestGoal(2))
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.text, ended.result) == (GoalStatus.ABORTED, "denied: true", 9)
        oracle.heard("status", 1)
        eventually(lambda: oracle.heard("status"), lambda told: told[-1]["status"] == "succeeded")  # as the server says

        def shown() -> set[int]:
            arrays = ear.heard("/count_mon/status")
            return {s.status for array in arrays for s in array.status_list if s.goal_id.id == goal_id}

        ear.until(lambda: GoalStatus.ABORTED in shown(), lambda: f"{shown()}")
        assert GoalStatus.SUCCEEDED not in shown()
        [event] = oracle.heard("result", 1)
        assert (event["status"], oracle.passed(event)) == ("succeeded", False)
        assert [said.result.result for said in ear.heard("/count_mon/result", 1)] == [9]
        process.ends_well()


def test_a_denied_cancel_does_not_pass_and_the_goal_goes_on(tmp_path: Path) -> None:
    answers: list[str | None] = ["not now", None]
    with watched(tmp_path, streams("cancel", ask="cancel"), lambda _: answers.pop(0)) as (scene, oracle, process):
        server(scene, last)
        peer = client(scene)
        goal, goal_id = peer.send_goal("/count_mon", msg.TestGoal(1))
        peer.fed(goal, 1)
        peer.cancel_goal(goal)
        process.said(f"denied a cancel of /count, goal {goal_id}: not now")
        [event] = oracle.heard("cancel", 1)
        assert (event["data"]["id"], oracle.passed(event)) == (goal_id, False)
        assert peer.ended(goal, wait=False) is None
        peer.cancel_goal(goal)
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.text) == (GoalStatus.PREEMPTED, "stopped")
        process.ends_well()


def test_replies_are_not_asked_about_and_it_is_told(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "reply", ask="goal reply")) as (scene, oracle, process):
        server(scene, refuse)
        peer = client(scene)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(1))
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.text) == (GoalStatus.REJECTED, "no")
        [reply] = oracle.heard("reply", 1)
        assert (reply["ask"], reply["status"], reply["data"]["accepted"]) == (False, "rejected", False)
        process.said("/count: replies are not decided on: on ROS 1 ")
        process.ends_well()


# Cancels


def test_a_cancel_while_a_goal_is_decided_on_ends_it_before_the_server_has_it(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "cancel", ask="goal"), lambda _: False) as (scene, oracle, process):
        serving, peer = server(scene, count), client(scene)
        goal, goal_id = peer.send_goal("/count_mon", msg.TestGoal(1))
        oracle.heard("goal", 1)
        peer.cancel_goal(goal)
        ended = peer.ended(goal)
        assert ended is not None
        assert ended.status == GoalStatus.RECALLED
        oracle.allow("goal")
        [event] = oracle.heard("goal")
        assert not oracle.passed(event)
        assert serving.goals("/count") == []
        [cancel] = oracle.heard("cancel", 1)
        assert (cancel["goal_id"], cancel["ask"]) == (goal_id, False)
        process.ends_well()


@pytest.mark.parametrize(
    ("behave", "text"), [(hesitate, "never begun"), (last, "stopped")], ids=["before acceptance", "after it"]
)
def test_a_cancel_reaches_the_server_and_its_end_the_client(
    behave: Callable[[Any, threading.Event], None], text: str, tmp_path: Path
) -> None:
    with watched(tmp_path, streams(*KINDS, ask="goal")) as (scene, oracle, process):
        serving, peer = server(scene, behave), client(scene)
        goal, goal_id = peer.send_goal("/count_mon", msg.TestGoal(1))
        serving.goals("/count", 1)
        peer.cancel_goal(goal)
        ended = peer.ended(goal)
        assert ended is not None
        assert ended.text == text
        assert ended.status in (GoalStatus.RECALLED, GoalStatus.PREEMPTED)
        [result] = oracle.heard("result", 1)
        assert (result["goal_id"], result["status"]) == (goal_id, "canceled")
        process.ends_well()


def test_a_cancel_of_all_ends_all(tmp_path: Path) -> None:
    held: list[bool] = []
    with watched(tmp_path, streams("goal", "cancel", "result", ask="goal"), lambda _: False if held else None) as (
        scene,
        oracle,
        process,
    ):
        serving, peer, other = server(scene, last), client(scene), client(scene)
        running = [(p, p.send_goal("/count_mon", msg.TestGoal(1))[0]) for p in (peer, other)]
        serving.goals("/count", 2)
        held.append(True)
        waiting, _ = other.send_goal("/count_mon", msg.TestGoal(2))
        oracle.heard("goal", 3)
        peer.cancel_all("/count_mon")
        ends = [p.ended(goal) for p, goal in running]
        assert [end.status for end in ends if end] == [GoalStatus.PREEMPTED] * 2
        end = other.ended(waiting)
        assert end is not None
        assert end.status == GoalStatus.RECALLED
        [cancel] = oracle.heard("cancel", 1)
        assert cancel["goal_id"] == ""
        assert len(serving.goals("/count")) == 2
        process.ends_well()
