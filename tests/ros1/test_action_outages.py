"""Goals on real ROS 1 where the oracle, their server or a monitor is away, comes late, or is there twice."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from actionlib import msg
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from tests.processes import eventually
from tests.ros1.actionscene import adapter, client, count, ids, last, server, streams, until_asked, watched
from tests.ros1.judge import judge

BACK = "(?m)/count: (recovered|(?!.*its server has gone).* or it has died)$"
"""A server is there again; the one that was killed may be told to be one of its publishers, as the master has it."""


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


def test_a_server_is_told_of_once_it_hears_what_is_passed_on(tmp_path: Path) -> None:
    def standing(goal: str) -> GoalStatusArray:
        return GoalStatusArray(status_list=[GoalStatus(GoalID(id=goal), GoalStatus.ACTIVE, "")])

    def told() -> list[str]:
        return [entry.goal_id.id for array in ear.heard("/count_mon/status") for entry in array.status_list]

    with watched(tmp_path, streams("goal", "status", ask="goal")) as (scene, oracle, process):
        starting, ear = scene.peer(), scene.peer()
        ear.record(GoalStatusArray, "/count_mon/status", speakers=1)
        starting.advertise(GoalStatusArray, "/count/status", latch=True)
        for count, goal in enumerate(("first", "second"), 1):
            starting.publish("/count/status", standing(goal))
            oracle.heard("status", count)
        starting.advertise(msg.TestActionFeedback, "/count/feedback")
        starting.advertise(msg.TestActionResult, "/count/result")
        starting.record(msg.TestActionGoal, "/count/goal", speakers=1)
        starting.record(GoalID, "/count/cancel", speakers=1)
        ear.until(told, lambda: "no status comes")
        assert set(told()) == {"second"}
        process.ends_well()


def test_a_goal_without_a_server_is_rejected(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", ask="goal")) as (scene, oracle, process):
        serving, peer = server(scene, last), client(scene)
        serving.close()

        def answered() -> tuple[int, str]:
            goal, _ = peer.send_goal("/count_mon", msg.TestGoal(1))
            ended = peer.ended(goal)
            assert ended is not None
            return ended.status, ended.text

        answer = answered()
        if answer == (GoalStatus.ABORTED, "the server of /count has gone"):  # it came before that had been noticed
            answer = answered()
        assert answer == (GoalStatus.REJECTED, "/count has no server")
        process.said("/count has no server: goal ")
        eventually(lambda: oracle.passed(oracle.heard("goal")[-1]), lambda passed: not passed)
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
        process.said(BACK)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(4))
        ended = peer.ended(goal)
        assert ended is not None
        assert ended.status == GoalStatus.SUCCEEDED
        assert not any("has gone" in trouble for trouble in oracle.troubles())
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

        def cancelled() -> object:
            peer.cancel_goal(goal)  # what rospy writes to the connection of the monitor that has gone is lost
            return peer._do("ended", goal)

        peer.until(cancelled, lambda: f"it is in {peer.states(goal)}")
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
