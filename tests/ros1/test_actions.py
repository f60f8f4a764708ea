"""Actions on real ROS 1, with real actionlib: what passes, and what is said of it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import rospy
from actionlib import msg
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from tests.processes import eventually
from tests.ros1.actionscene import (
    KINDS,
    adapter,
    client,
    count,
    count_fast,
    hesitate,
    ids,
    last,
    server,
    streams,
    watched,
)  # fmt: skip
from tests.ros1.harness import Scene
from tests.ros1.judge import judge

FEEDBACK = 1000
"""How many messages of feedback are sent at 500 Hz."""


def test_goals_of_three_clients_at_once_go_as_without_a_monitor(tmp_path: Path) -> None:
    with watched(tmp_path, streams(*KINDS, ask="goal")) as (scene, oracle, process):
        serving, ear = server(scene, count), scene.peer()
        ear.record(msg.TestActionFeedback, "/count_mon/feedback", speakers=1)
        clients = [client(scene) for _ in range(3)]
        sent = [
            (clients[number % 3], number, *clients[number % 3].send_goal("/count_mon", msg.TestGoal(number)))
            for number in range(20)
        ]
        for peer, number, goal, _ in sent:
            ended = peer.ended(goal)
            assert ended is not None
            assert (ended.status, ended.text, ended.result) == (GoalStatus.SUCCEEDED, "counted", 10 * number)
        passed = [(said.status.goal_id.id, said.feedback.feedback) for said in ear.heard("/count_mon/feedback", 190)]
        for *_, number, _, goal_id in sent:  # clients drop what the result overtakes, which is sent beside it
            assert [of for goal, of in passed if goal == goal_id] == list(range(1, number + 1))
        wanted = sorted(goal_id for *_, goal_id in sent)
        assert sorted(serving.goals("/count")) == wanted
        oracle.heard("feedback", 190)
        for kind in ("goal", "reply", "result"):
            assert sorted(ids(oracle.heard(kind, 20))) == wanted
        for *_, number, _, goal_id in sent:
            of_goal = [event for event in oracle.heard() if event["goal_id"] == goal_id]
            told = [event["kind"] for event in of_goal if event["kind"] != "status"]
            assert told[:2] == ["goal", "reply"]
            assert sorted(told[2:]) == [*["feedback"] * number, "result"]
            goal, reply = of_goal[0], next(event for event in of_goal if event["kind"] == "reply")
            assert (goal["ask"], goal["data"], oracle.passed(goal)) == (True, {"goal": number}, True)
            assert reply["call"] == goal["call"]
            assert (reply["status"], reply["data"]["accepted"]) == ("accepted", True)
            [result] = [event for event in of_goal if event["kind"] == "result"]
            assert (result["status"], result["data"]) == ("succeeded", {"result": 10 * number})
        process.ends_well()


def test_what_passes_is_byte_for_byte_what_came(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", ask="goal")) as (scene, _, process):
        server(scene, count)
        ear, peer = scene.peer(), client(scene)
        for kind in ("goal", "feedback", "result", "status"):
            for side in ("/count", "/count_mon"):
                ear.record(rospy.AnyMsg, f"{side}/{kind}", speakers=1)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(3))
        peer.ended(goal)
        for kind, times in (("goal", 1), ("feedback", 3), ("result", 1)):
            came, went = (ear.heard(f"{side}/{kind}", times) for side in ("/count", "/count_mon"))
            assert [said._buff for said in came] == [said._buff for said in went]
        came = {said._buff for said in ear.heard("/count/status", 3)}
        assert {said._buff for said in ear.heard("/count_mon/status", 3)} & came
        process.ends_well()


def test_feedback_at_500_hz_passes_whole_and_in_order(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "feedback", ask="goal")) as (scene, oracle, process):
        server(scene, count_fast)
        peer, ear = client(scene), scene.peer()
        ear.record(msg.TestActionFeedback, "/count_mon/feedback", speakers=1)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(FEEDBACK))
        peer.ended(goal)
        every = list(range(1, FEEDBACK + 1))
        assert [said.feedback.feedback for said in ear.heard("/count_mon/feedback", FEEDBACK)] == every
        assert [event["data"]["feedback"] for event in oracle.heard("feedback", FEEDBACK)] == every
        process.ends_well()


def test_a_status_is_told_once_a_transition(tmp_path: Path) -> None:
    with watched(tmp_path, streams("reply", "status")) as (scene, oracle, process):
        server(scene, hesitate)
        peer = client(scene)
        goal, goal_id = peer.send_goal("/count_mon", msg.TestGoal(1))
        oracle.heard("status", 1)  # it is pending
        assert oracle.heard("reply") == []
        peer.cancel_goal(goal)
        peer.ended(goal)
        told = eventually(lambda: oracle.heard("status"), lambda found: found[-1]["status"] == "canceled")
        assert [(event["goal_id"], event["status"]) for event in told] == [
            (goal_id, word) for word in ("unknown", "canceling", "canceled")
        ]
        [reply] = oracle.heard("reply", 1)
        assert (reply["status"], reply["data"]["accepted"]) == ("rejected", False)
        process.ends_well()


def test_a_late_client_hears_how_goals_stand(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "status", ask="goal")) as (scene, _, process):
        server(scene, last)
        peer, late = client(scene), scene.peer()
        goal, goal_id = peer.send_goal("/count_mon", msg.TestGoal(1))
        peer.fed(goal, 1)
        late.record(GoalStatusArray, "/count_mon/status")
        late.until(
            lambda: (
                [(s.goal_id.id, s.status) for a in late.heard("/count_mon/status") for s in a.status_list][:1]
                == [(goal_id, GoalStatus.ACTIVE)]
            ),
            lambda: "it hears of no goal",
        )
        process.ends_well()


def test_an_action_is_observed_without_a_proxy(tmp_path: Path) -> None:
    with watched(tmp_path, streams(*KINDS, via="introspection", proxy="")) as (scene, oracle, process):
        server(scene, count)
        peer = client(scene, "/count")
        eventually(lambda: peer.send_goal("/count", msg.TestGoal(2)), lambda _: oracle.heard("goal"))
        goal, goal_id = peer.send_goal("/count", msg.TestGoal(2))
        peer.ended(goal)
        peer.cancel_all("/count")
        eventually(
            lambda: {e["kind"] for e in oracle.heard() if e["goal_id"] in (goal_id, "")}, lambda k: k == {*KINDS}
        )
        found = [event for event in oracle.heard() if event["goal_id"] == goal_id]
        assert not any(event["ask"] for event in found)
        assert [event["data"] for event in found if event["kind"] == "feedback"] == [{"feedback": 1}, {"feedback": 2}]
        [reply] = [event for event in found if event["kind"] == "reply"]
        assert reply["status"] == "accepted"
        process.ends_well()


def test_a_reply_that_comes_before_its_goal_is_told(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "reply", "status", via="introspection", proxy="")) as (
        scene,
        oracle,
        process,
    ):
        peer = scene.peer()
        peer.advertise(msg.TestActionGoal, "/count/goal")
        peer.advertise(GoalStatusArray, "/count/status")
        peer.publish(
            "/count/status", GoalStatusArray(status_list=[GoalStatus(GoalID(id="early"), GoalStatus.ACTIVE, "")])
        )
        oracle.heard("status", 1)
        assert oracle.heard("reply") == []
        peer.publish("/count/goal", msg.TestActionGoal(goal_id=GoalID(id="early")))
        [reply] = oracle.heard("reply", 1)
        [goal] = oracle.heard("goal", 1)
        assert (reply["goal_id"], reply["status"], reply["call"]) == ("early", "accepted", goal["call"])
        process.ends_well()


@pytest.mark.parametrize("via", ["introspection", "proxy"])
def test_how_goals_stood_before_is_not_told(via: str, tmp_path: Path) -> None:
    described = streams("status", via=via, proxy="/count_mon" if via == "proxy" else "")
    with judge(described) as oracle, Scene(tmp_path) as scene:
        server(scene, last)
        peer = client(scene, "/count")
        goal, goal_id = peer.send_goal("/count", msg.TestGoal(1))
        peer.fed(goal, 1)
        process = adapter(scene, oracle)

        def told(goal_id: str) -> list[str]:
            return [event["status"] for event in oracle.heard("status") if event["goal_id"] == goal_id]

        _, next_id = peer.send_goal("/count", msg.TestGoal(1))
        eventually(lambda: told(next_id), lambda found: "executing" in found)  # its server is heard
        peer.cancel_goal(goal)
        assert "executing" not in eventually(lambda: told(goal_id), lambda found: "canceled" in found)
        process.ends_well()


def test_goals_without_an_id_are_told_where_they_are_only_observed(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "reply", via="introspection", proxy="")) as (scene, oracle, process):
        server(scene, count)
        peer = scene.peer()
        peer.advertise(msg.TestActionGoal, "/count/goal", listeners=2)
        peer.publish("/count/goal", msg.TestActionGoal())
        [goal] = oracle.heard("goal", 1)
        assert goal["goal_id"] == ""
        process.said("/count: /peer1 sends goals without an id: their server gives them one that nobody else knows")
        eventually(oracle.troubles, lambda told: any("/peer1 sends goals without an id" in one for one in told))
        process.ends_well()


def test_another_type_than_the_specs_is_told_and_does_not_pass(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal")) as (scene, oracle, process):
        serving, odd = server(scene, count), scene.peer()
        odd.advertise(GoalID, "/count_mon/goal")
        odd.publish("/count_mon/goal", GoalID(id="x"))
        why = "it publishes actionlib_msgs/GoalID, and the spec says actionlib/TestActionGoal"
        process.said(f"/count: nothing of .* can be read: {why}")
        assert (oracle.heard("goal"), serving.goals("/count")) == ([], [])
        process.ends_well()


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("nowhere/action/Fly", "the type nowhere/FlyActionGoal can't be loaded; is its package built and sourced"),
        (
            "actionlib/action/TestAction",
            "called as its file is, as actionlib/action/Test, and not actionlib/TestAction",
        ),
    ],
    ids=["of no package", "called as its Python class"],
)
def test_an_action_of_a_type_that_is_not_there_ends_the_adapter(kind: str, why: str, tmp_path: Path) -> None:
    described = [{**one, "type": kind} for one in streams("goal")]
    with judge(described) as oracle, Scene(tmp_path) as scene:
        process = scene.run("adapter", sys.executable, "-m", "oracle_ros1", "--oracle", oracle.url, "--spec", "s")
        process.said(why)
        assert process.wait() == 2
