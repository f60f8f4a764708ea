"""An action in a session of a real oracle, beside services and in simulated time, on real ROS 1."""

from __future__ import annotations

import itertools
import threading
from pathlib import Path
from typing import Any, Self

import rospy
from actionlib import msg
from actionlib_msgs.msg import GoalStatus
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from tests.adapters.standin import SWITCHES
from tests.processes import eventually
from tests.robot import spec_folder
from tests.ros1.actionscene import client, count, server, until_asked
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


class World:
    """Simulated time that goes on."""

    def __init__(self, scene: Scene, start: int) -> None:
        self._peer, self._over = scene.peer(), threading.Event()
        self._peer.parameter("/use_sim_time", True)
        self._peer.advertise(Clock, "/clock", listeners=0, latch=True)
        self.set(start)
        self._thread = threading.Thread(target=self._tick)

    def set(self, seconds: int) -> None:
        """Go on from there."""
        self._hundredths = itertools.count(100 * seconds)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _tick(self) -> None:
        while not self._over.wait(0.01):
            seconds, rest = divmod(next(self._hundredths), 100)
            self._peer.publish("/clock", Clock(rospy.Time(seconds, rest * 10_000_000)))


def test_in_simulated_time_an_action_is_judged_by_it(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION))) as scene, World(scene, 100):
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


SLOW = """
  - topic: /slow
    type: std_msgs/Header
    stamp: stamp
    latency: 200s"""
"""A topic for whose clock all decisions wait, 200 s of simulated time."""


def test_a_clock_that_goes_back_in_a_goal_begins_another_session_and_the_goal_goes_on(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION))) as scene, World(scene, 100) as world:
        adapter = scene.adapter("counting")
        server(scene, until_asked)
        peer = client(scene)
        goal, _ = peer.send_goal("/count_mon", msg.TestGoal(1))
        peer.until(lambda: peer.states(goal), lambda: "it is not taken")
        world.set(10)
        adapter.said(r"attached s\.run2")
        assert peer.ended(goal, wait=False) is None
        peer.cancel_goal(goal)
        ended = peer.ended(goal)
        assert ended is not None
        assert (ended.status, ended.text, ended.result) == (GoalStatus.SUCCEEDED, "done all the same", 3)
        long, _ = peer.send_goal("/count_mon", msg.TestGoal(60))
        ended = peer.ended(long)
        assert ended is not None
        assert (ended.status, ended.text) == (GoalStatus.REJECTED, "denied: short")
        adapter.ends_well()
        first, second = scene.server.session("s"), scene.server.session("s.run2")
        assert (first["status"], first["continued_by"]) == ("closed", "s.run2")
        assert violated(first) == set()
        # the result's goal has no reply in this session
        assert violated(second) == {"short", "end_has_a_reply"}
        assert all(session["counters"]["lost"] == 0 for session in (first, second))
        events = scene.server.events("s.run2")
        assert all(event["stamp"] < 100 * SECOND for event in events)
        assert not any(event["late"] or event["skewed"] for event in events)


def test_goals_that_wait_for_their_decision_as_the_clock_goes_back_do_not_pass_by_accident(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION, SLOW))) as scene, World(scene, 1000) as world:
        adapter = scene.adapter("counting")
        serving = server(scene, count)
        peer = client(scene)
        eventually(lambda: reached(scene), lambda time: time > 1000 * SECOND)
        goals = [peer.send_goal("/count_mon", msg.TestGoal(number)) for number in (60, 3)]
        eventually(lambda: scene.server.session("s")["counters"]["held"], lambda held: held == 2)
        assert [peer.states(goal) for goal, _ in goals] == [[], []]
        world.set(10)
        ended = peer.ended(goals[0][0])
        assert ended is not None
        assert (ended.status, ended.text) == (GoalStatus.REJECTED, "denied: short")
        assert serving.goals("/count", 1) == [goals[1][1]]
        adapter.ends_well()
        assert violated(scene.server.session("s")) == {"short"}, "as the session that ends decides"


def reached(scene: Scene) -> int:
    """How far the goals of a session have come, in its time."""
    return max((s["frontier"] or 0 for s in scene.server.session("s")["streams"] if s["kind"] == "goal"), default=0)


def violated(session: Any) -> set[str]:
    return {one["id"] for one in session["properties"] if one["violations"]}
