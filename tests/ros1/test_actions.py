"""Actions on real ROS 1, with real actionlib: what passes, what doesn't, and what is said of it."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import rospy
from actionlib import msg
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from tests.adapters.standin import described
from tests.processes import Data, Process, eventually
from tests.ros1.harness import Peer, Scene
from tests.ros1.judge import Decide, Judge, judge

KINDS = ("goal", "reply", "feedback", "cancel", "result", "status")
FEEDBACK = 1000
"""How many messages of feedback are sent at 500 Hz."""


def streams(*kinds: str, ask: str = "", name: str = "/count", **more: Any) -> list[Data]:
    """An action of which some kinds are described, and some of these asked about."""
    whole: Data = {"proxy": f"{name}_mon", "via": "proxy", "denied_result": {"result": 9}, "fields": None, **more}
    return [
        described(name, kind, "actionlib/action/Test", action="filter" if kind in ask.split() else "log", **whole)
        for kind in kinds
    ]


@contextmanager
def watched(
    folder: Path, described: list[Data], decide: Decide = lambda _: None
) -> Iterator[tuple[Scene, Judge, Process]]:
    """A graph with an adapter of an oracle that the test makes up."""
    with judge(described, decide) as oracle, Scene(folder) as scene:
        yield scene, oracle, adapter(scene, oracle)


def adapter(scene: Scene, oracle: Judge, name: str = "uav1") -> Process:
    words = ("--oracle", oracle.url, "--spec", "s", "--monitor", name)
    process = scene.run("adapter", sys.executable, "-m", "oracle_ros1", *words)
    process.said("observing")
    return process


def client(scene: Scene, name: str = "/count_mon") -> Peer:
    peer = scene.peer()
    peer.connect(msg.TestAction, name)
    return peer


def server(scene: Scene, behave: Callable[[Any, threading.Event], None], name: str = "/count") -> Peer:
    peer = scene.peer()
    peer.serve_action(msg.TestAction, name, behave)
    return peer


def ids(events: list[Data]) -> list[str]:
    return [event["goal_id"] for event in events]


# What servers do


def count(goal: Any, _: threading.Event) -> None:
    """Count up to the goal, and say ten times as much."""
    goal.set_accepted()
    wanted = goal.get_goal().goal
    for number in range(1, wanted + 1):
        goal.publish_feedback(msg.TestFeedback(number))
    goal.set_succeeded(msg.TestResult(10 * wanted), "counted")


def count_fast(goal: Any, _: threading.Event) -> None:
    """Count at 500 Hz."""
    goal.set_accepted()
    due = time.monotonic()
    for number in range(1, goal.get_goal().goal + 1):
        goal.publish_feedback(msg.TestFeedback(number))
        due += 0.002
        time.sleep(max(0.0, due - time.monotonic()))
    goal.set_succeeded(msg.TestResult(0))


def last(goal: Any, cancelled: threading.Event) -> None:
    """Go on until the goal is cancelled."""
    goal.set_accepted()
    goal.publish_feedback(msg.TestFeedback(0))
    cancelled.wait()
    goal.set_canceled(msg.TestResult(1), "stopped")


def hesitate(goal: Any, cancelled: threading.Event) -> None:
    """Decide on a goal only once it is cancelled."""
    cancelled.wait()
    goal.set_canceled(msg.TestResult(2), "never begun")


def refuse(goal: Any, _: threading.Event) -> None:
    goal.set_rejected(msg.TestResult(), "no")


def until_asked(goal: Any, cancelled: threading.Event) -> None:
    """Succeed when it is cancelled: late enough for a test to do something in between."""
    goal.set_accepted()
    cancelled.wait()
    goal.set_succeeded(msg.TestResult(3), "done all the same")


# What passes


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


# Who goes away


@pytest.mark.parametrize("unavailable", ["deny", "pass"])
def test_without_an_oracle_goals_go_by_the_spec_and_cancels_always_pass(unavailable: str, tmp_path: Path) -> None:
    described = streams("goal", "cancel", ask="goal cancel", on_unavailable=unavailable, decide_within=400_000_000)
    away: list[bool] = []
    with watched(tmp_path, described, lambda _: False if away else None) as (scene, _, process):
        server(scene, last)
        peer = client(scene)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(1))
        peer.fed(goal, 1)
        away.append(True)
        peer.cancel_goal(goal)
        ended = peer.ended(goal)
        assert ended is not None
        assert ended.status == GoalStatus.PREEMPTED
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(2))
        if unavailable == "pass":
            peer.fed(goal, 1)
        else:
            ended = peer.ended(goal)
            assert ended is not None
            assert (ended.status, ended.text) == (GoalStatus.REJECTED, "denied: no decision in time")
        process.ends_well()


def test_a_goal_without_a_server_is_rejected(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", ask="goal")) as (scene, _, process):
        serving, peer = server(scene, last), client(scene)
        serving.close()
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(1))
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.text) == (GoalStatus.REJECTED, "/count has no server")
        process.said("/count has no server: goal 1 is rejected")
        late = scene.peer()
        late.record(GoalStatusArray, "/count_mon/status", speakers=1)
        assert late.heard("/count_mon/status") == []  # what its server said once is not taken for a server
        process.ends_well()


def test_a_server_that_dies_in_a_goal_ends_it_as_aborted_and_its_next_life_is_used(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "result", ask="goal")) as (scene, oracle, process):
        serving, peer = server(scene, last), client(scene)
        goals = [peer.send_goal("/count_mon", msg.TestGoal(1))[0] for _ in range(2)]
        for goal in goals:
            peer.fed(goal, 1)
        serving.close()
        for goal in goals:
            ended = peer.ended(goal)
            assert ended is not None
            assert (ended.status, ended.text) == (GoalStatus.ABORTED, "the server of /count has gone")
        process.said("/count: its server has gone; goals answered as aborted: 2")
        server(scene, count)
        process.said("/count: recovered")
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(4))
        ended = peer.ended(goal)
        assert ended is not None
        assert ended.status == GoalStatus.SUCCEEDED
        assert oracle.troubles() == []
        process.ends_well()


def test_a_goal_outlives_a_restart_of_the_monitor(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "cancel", "result", ask="goal result")) as (scene, oracle, process):
        server(scene, until_asked)
        peer = client(scene)
        goal, goal_id = peer.send_goal("/count_mon", msg.TestGoal(1))
        oracle.heard("goal", 1)
        peer.until(lambda: peer.states(goal), lambda: "it is not taken")
        process.ends_well()
        assert "/count: the monitor ends; goals that go on at the server: 1" in process.log
        second = adapter(scene, oracle)
        peer.until(lambda: peer._do("connected", "/count_mon"), lambda: "the client does not come back")
        peer.cancel_goal(goal)
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.text, ended.result) == (GoalStatus.SUCCEEDED, "done all the same", 3)
        [result] = oracle.heard("result", 1)
        assert (result["goal_id"], result["status"]) == (goal_id, "succeeded")
        second.ends_well()


def test_goals_that_wait_when_the_monitor_ends_are_rejected(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", ask="goal"), lambda _: False) as (scene, oracle, process):
        serving, peer = server(scene, count), client(scene)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(1))
        [event] = oracle.heard("goal", 1)
        process.ends_well(signal.SIGINT)
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.text) == (GoalStatus.REJECTED, "the monitor ends")
        assert not oracle.passed(event)
        assert serving.goals("/count") == []


def test_two_monitors_watch_one_action_one_behind_the_other(tmp_path: Path) -> None:
    first, second = streams("goal", "result", ask="goal"), streams("goal", "result", ask="goal", name="/count_mon")
    with judge(second) as behind, watched(tmp_path, first) as (scene, oracle, process):
        other = adapter(scene, behind, "uav2")
        server(scene, count)
        peer = client(scene, "/count_mon_mon")
        goal, goal_id = peer.send_goal("/count_mon_mon", msg.TestGoal(3))
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.result) == (GoalStatus.SUCCEEDED, 30)
        for judged in (oracle, behind):
            assert ids(judged.heard("goal", 1)) == ids(judged.heard("result", 1)) == [goal_id]
        process.ends_well()
        other.ends_well()


def test_two_monitors_beside_each_other_tell_of_each_other(tmp_path: Path) -> None:
    first, second = streams("goal", ask="goal"), streams("goal", ask="goal", proxy="/count_2")
    with judge(second) as beside, watched(tmp_path, first) as (scene, oracle, process):
        other = adapter(scene, beside, "uav2")
        server(scene, count)
        for name, judged in (("/count_mon", oracle), ("/count_2", beside)):
            peer = client(scene, name)
            goal, goal_id = peer.send_goal(name, msg.TestGoal(2))
            ended = peer.ended(goal)
            assert ended is not None
            assert ended.status == GoalStatus.SUCCEEDED
            assert ids(judged.heard("goal", 1)) == [goal_id]
        process.said("/count: /uav2 publishes /count/goal past the monitor")
        other.said("/count: /uav1 publishes /count/goal past the monitor")
        process.ends_well()
        other.ends_well()


# What is wrong


def test_another_type_than_the_specs_is_told_and_does_not_pass(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal")) as (scene, oracle, process):
        serving, odd = server(scene, count), scene.peer()
        odd.advertise(GoalID, "/count_mon/goal")
        odd.publish("/count_mon/goal", GoalID(id="x"))
        why = "it publishes actionlib_msgs/GoalID, and the spec says actionlib/TestActionGoal"
        process.said(f"/count: nothing of .* can be read: {why}")
        assert (oracle.heard("goal"), serving.goals("/count")) == ([], [])
        process.ends_well()


def test_an_action_whose_package_is_missing_ends_the_adapter(tmp_path: Path) -> None:
    described = [{**one, "type": "nowhere/action/Fly"} for one in streams("goal")]
    with judge(described) as oracle, Scene(tmp_path) as scene:
        process = scene.run("adapter", sys.executable, "-m", "oracle_ros1", "--oracle", oracle.url, "--spec", "s")
        process.said("the type nowhere/FlyActionGoal can't be loaded; is its package built and sourced")
        assert process.wait() == 2
