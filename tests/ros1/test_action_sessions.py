"""An action in a session of a real oracle, beside services and in simulated time, on real ROS 1."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rospy
from actionlib import msg
from actionlib_msgs.msg import GoalStatus
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from tests.adapters.standin import SWITCHES
from tests.robot import spec_folder
from tests.ros1.actionscene import client, count, server
from tests.ros1.harness import Scene

SECOND = 10**9
ACTION = """
  - ros_action: /count
    type: actionlib/action/Test
    action: filter
    ask: [goal, result]
    latency: 200s
    decide_within: 300s
    goal: {signals: {number: msg.goal}}
    reply: {}
    feedback: {signals: {said: msg.feedback}}
    result: {signals: {found: msg.result}}
    status: {}"""
SERVICE = """
  - service: NAME
    type: std_srvs/srv/SetBool
    action: filter
    decide_within: 300s
    request: {signals: {on: msg.data}}
    response: {signals: {done: msg.success}}"""
RULES = """
properties:
  - {id: short, formula: 'not {ros_action: "/count", kind: goal, number > 50}', guards: [/count]}
  - id: feedback_has_a_reply
    formula: 'forall[g]. {kind: feedback, goal_id: *g} -> once{kind: reply, goal_id: *g, status: accepted}'
  - id: end_has_a_reply
    formula: 'forall[g]. {kind: result, goal_id: *g, status: succeeded} -> once{kind: reply, goal_id: *g}'
"""
DELAY = "ordering: {max_delay: 250s}\n"
"""So that what waits for the clock of anything else fails."""


def spec(*streams: str, more: str = "") -> str:
    return "id: counting\n" + DELAY + "streams:" + "".join(streams) + RULES + more


def succeed(_: Any) -> Any:
    return SetBoolResponse(success=True)


def test_four_services_and_an_action_do_not_wait_for_each_other(tmp_path: Path) -> None:
    services = [SERVICE.replace("NAME", name) for name in SWITCHES]
    guards = ", ".join(SWITCHES)
    off = f"  - {{id: off, formula: 'not {{service: \"/first\", kind: request, on: true}}', guards: [{guards}]}}\n"
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION, *services, more=off))) as scene:
        adapter = scene.adapter("counting")
        serving = server(scene, count)
        for name in SWITCHES:
            serving.serve(SetBool, name, succeed)
        peer = client(scene)
        goals = [peer.send_goal("/count_mon", msg.TestGoal(number))[0] for number in (20, 60, 10)]
        answers = [peer.call(SetBool, f"{name}_mon", SetBoolRequest(True)) for name in SWITCHES]
        ends = [peer.ended(goal) for goal in goals]
        wanted = [GoalStatus.SUCCEEDED, GoalStatus.REJECTED, GoalStatus.SUCCEEDED]
        assert [end.status for end in ends if end] == wanted
        assert [answer and answer.success for answer, _ in answers] == [None, True, True, True]
        assert "off" in str(answers[0][1])
        adapter.ends_well()
        session = scene.server.session("s")
        assert (session["counters"]["late"], session["counters"]["lost"]) == (0, 0)
        assert violated(session) == {"short", "off"}


@contextmanager
def going_on(scene: Scene, start: int) -> Iterator[None]:
    """Simulated time that goes on."""
    world, over = scene.peer(), threading.Event()
    world.parameter("/use_sim_time", True)
    world.advertise(Clock, "/clock", listeners=0, latch=True)

    def tick() -> None:
        for number in itertools.count():
            if over.wait(0.01):
                break
            world.publish("/clock", Clock(rospy.Time(start + number // 100, number % 100 * 10_000_000)))

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_in_simulated_time_an_action_is_judged_by_it(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION))) as scene, going_on(scene, 100):
        adapter = scene.adapter("counting")
        server(scene, count)
        peer = client(scene)
        goals = [peer.send_goal("/count_mon", msg.TestGoal(number))[0] for number in (3, 60)]
        ends = [peer.ended(goal) for goal in goals]
        assert [end.status for end in ends if end] == [GoalStatus.SUCCEEDED, GoalStatus.REJECTED]
        adapter.ends_well()
        session, events = scene.server.session("s"), scene.server.events("s")
        assert (session["clock"], violated(session)) == ("sim", {"short"})
        assert {"goal", "reply", "feedback", "result"} <= {event["kind"] for event in events}
        assert all(100 * SECOND <= event["stamp"] < 1000 * SECOND for event in events)
        assert not any(event["late"] or event["skewed"] for event in events)


def violated(session: Any) -> set[str]:
    return {one["id"] for one in session["properties"] if one["violations"]}
