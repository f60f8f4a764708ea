"""Clients of an action on real ROS 1 that do what actionlib's don't: their own ids, and cancels by time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from actionlib import msg
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from oracle_ros1 import actionmessages
from rospy import AnyMsg, Time

from tests.processes import Data
from tests.ros1.actionscene import count, ids, last, server, streams, watched
from tests.ros1.harness import Peer, Scene

DENIED, OPEN = 7, 8
"""The goals that are denied, and not decided on."""


def decide(event: Data) -> str | Literal[False] | None:
    return {DENIED: "no_sevens", OPEN: False}.get(event["data"].get("goal"))


def raw(scene: Scene) -> Peer:
    """A client that publishes goals and cancels itself; its server is heard first."""
    peer = scene.peer()
    for kind, name in ((GoalStatusArray, "status"), (msg.TestActionResult, "result")):
        peer.record(kind, f"/count_mon/{name}", speakers=1)
    for kind, name in ((msg.TestActionGoal, "goal"), (GoalID, "cancel")):
        peer.advertise(kind, f"/count_mon/{name}")
    peer.heard("/count_mon/status", 1)
    return peer


def send(peer: Peer, number: int, goal_id: str, seconds: int = 1) -> None:
    peer.publish(
        "/count_mon/goal", msg.TestActionGoal(goal_id=GoalID(Time(seconds), goal_id), goal=msg.TestGoal(number))
    )


def ended(peer: Peer, count: int) -> list[tuple[str, int]]:
    """The goals that have ended, and how, once there are so many."""
    return sorted((one.status.goal_id.id, one.status.status) for one in peer.heard("/count_mon/result", count))


def shown(peer: Peer, goal_id: str) -> list[int]:
    """How a goal stands by each array of statuses."""
    arrays: list[Any] = peer.heard("/count_mon/status")
    return [one.status for array in arrays for one in array.status_list if one.goal_id.id == goal_id]


def test_a_goal_that_is_sent_again_under_its_id_and_denied_goes_on(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", ask="goal"), decide) as (scene, oracle, process):
        serving = server(scene, last)
        peer = raw(scene)
        send(peer, 1, "mine")
        serving.goals("/count", 1)
        peer.until(lambda: GoalStatus.ACTIVE in shown(peer, "mine"), lambda: "it is not shown")
        send(peer, DENIED, "mine")
        process.said("denied a goal of /count, goal mine: no_sevens")
        send(peer, DENIED, "other")
        assert ended(peer, 1) == [("other", GoalStatus.REJECTED)]
        send(peer, OPEN, "mine")
        oracle.heard("goal", 4)
        peer.publish("/count_mon/cancel", GoalID(id="mine"))
        assert ended(peer, 2) == [("mine", GoalStatus.PREEMPTED), ("other", GoalStatus.REJECTED)]
        assert not {GoalStatus.REJECTED, GoalStatus.RECALLED} & set(shown(peer, "mine"))
        process.ends_well()


def test_a_goal_that_was_denied_and_is_allowed_under_its_id_is_shown_as_it_goes_on(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "status", ask="goal"), decide) as (scene, oracle, process):
        serving = server(scene, last)
        peer = raw(scene)
        send(peer, DENIED, "mine")
        assert ended(peer, 1) == [("mine", GoalStatus.REJECTED)]
        send(peer, 1, "mine")
        serving.goals("/count", 1)
        peer.until(lambda: GoalStatus.ACTIVE in shown(peer, "mine"), lambda: "it is not shown")
        assert "executing" in [event["status"] for event in oracle.heard("status", 1)]
        peer.publish("/count_mon/cancel", GoalID(id="mine"))
        assert ended(peer, 2) == [("mine", GoalStatus.PREEMPTED), ("mine", GoalStatus.REJECTED)]
        process.ends_well()


def test_a_cancel_by_time_ends_what_is_older_wherever_it_is(tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", "cancel", ask="goal"), decide) as (scene, oracle, process):
        serving = server(scene, last)
        peer = raw(scene)
        for number, goal_id, seconds in (
            (1, "old", 10),
            (1, "new", 30),
            (OPEN, "old and open", 20),
            (OPEN, "open", 40),
        ):
            send(peer, number, goal_id, seconds)
        oracle.heard("goal", 4)
        serving.goals("/count", 2)
        peer.publish("/count_mon/cancel", GoalID(stamp=Time(25)))
        assert ended(peer, 2) == [("old", GoalStatus.PREEMPTED), ("old and open", GoalStatus.RECALLED)]
        [cancel] = oracle.heard("cancel", 1)
        assert (cancel["goal_id"], cancel["data"]["stamp"]["sec"]) == ("", 25)
        oracle.allow("goal")
        assert serving.goals("/count", 3) == ["old", "new", "open"]
        peer.publish("/count_mon/cancel", GoalID())
        assert [goal_id for goal_id, _ in ended(peer, 4)] == ["new", "old", "old and open", "open"]
        process.ends_well()


def test_what_else_a_goal_without_an_id_says_is_left_as_it_came() -> None:
    frame = b"caf\xe9"  # no UTF-8
    before = b"\7\0\0\0" + bytes(range(8)) + b"\4\0\0\0" + frame + bytes(range(8, 16))
    goal = b"\3\0\0\0" + b"behind its end"
    message = AnyMsg()
    message._connection_header = {"type": "actionlib/TestActionGoal"}
    message._buff = before + b"\0\0\0\0" + goal
    read = msg.TestActionGoal().deserialize(message._buff)
    made = actionmessages.with_id(read, message, "n\u00e4he")
    assert made._buff == before + b"\5\0\0\0" + b"n\xc3\xa4he" + goal
    assert made._connection_header is message._connection_header
    found = msg.TestActionGoal().deserialize(made._buff)
    assert (found.goal_id.id, found.goal.goal) == (read.goal_id.id, 3) == ("n\u00e4he", 3)


def test_a_goal_without_an_id_gets_one_by_which_all_that_comes_of_it_is_known(tmp_path: Path) -> None:
    described = streams("goal", "reply", "result", "status", ask="goal")
    with watched(tmp_path, described, decide) as (scene, oracle, process):
        serving = server(scene, count)
        peer = raw(scene)
        send(peer, 1, "")
        send(peer, 2, "")
        ends = ended(peer, 2)
        send(peer, DENIED, "")
        assert [code for _, code in ends] == [GoalStatus.SUCCEEDED] * 2
        [rejected] = [goal_id for goal_id, code in ended(peer, 3) if code == GoalStatus.REJECTED]
        given = [goal_id for goal_id, _ in ends]
        assert sorted(serving.goals("/count", 2)) == given
        assert len({*given, rejected, ""}) == 4
        assert sorted(ids(oracle.heard("goal", 3))) == sorted([*given, rejected])
        assert sorted(ids(oracle.heard("reply", 2))) == given
        assert sorted(ids(oracle.heard("result", 2))) == given
        process.ends_well()
        assert "goals that go on" not in process.log
