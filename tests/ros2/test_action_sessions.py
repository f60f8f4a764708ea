"""An action in a session of a real oracle, with what else there may be: services, simulated time, servers that die."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from tests.adapters.standin import SWITCHES
from tests.robot import spec_folder
from tests.ros2.acting import ABORTED, SUCCEEDED, Client, acting, hex_of, streams
from tests.ros2.harness import Peer, Scene, eventually

clock_msgs = pytest.importorskip("rosgraph_msgs.msg")
time_msg = pytest.importorskip("builtin_interfaces.msg")
srv = pytest.importorskip("std_srvs.srv")

# rclpy imports an old lark with its first node, and warns by functions of its own that are deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)
SECOND = 10**9
ACTION = """
  - ros_action: /fib
    type: test_msgs/action/Fibonacci
    action: filter
    ask: [goal, result]
    latency: 200s
    decide_within: 300s
    goal: {signals: {order: msg.order}}
    reply: {}
    feedback: {signals: {said: size(msg.sequence)}}
    result: {signals: {length: size(msg.sequence)}}
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
  - {id: short, formula: 'not {ros_action: "/fib", kind: goal, order > 50}', guards: [/fib]}
  - id: feedback_has_a_reply
    formula: 'forall[g]. {kind: feedback, goal_id: *g} -> once{kind: reply, goal_id: *g, status: accepted}'
  - id: end_has_a_reply
    formula: 'forall[g]. {kind: status, goal_id: *g, status: succeeded} -> once{kind: reply, goal_id: *g}'
"""
DELAY = "ordering: {max_delay: 250s}\n"
"""So that what waits for the clock of anything else fails."""


def spec(*streams: str, more: str = "") -> str:
    return "id: fib\n" + DELAY + "streams:" + "".join(streams) + RULES + more


def fibonacci(scene: Scene) -> None:
    scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", 0.01).said("ready")


def test_four_services_and_an_action_do_not_wait_for_each_other(tmp_path: Path) -> None:
    services = [SERVICE.replace("NAME", name) for name in SWITCHES]
    guards = ", ".join(SWITCHES)
    off = f"  - {{id: off, formula: 'not {{service: \"/first\", kind: request, on: true}}', guards: [{guards}]}}\n"
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION, *services, more=off))) as scene:
        adapter = scene.adapter("fib")
        fibonacci(scene)
        peer = scene.peer()
        for name in SWITCHES:

            def switch(_request: object, response: object) -> object:
                response.success = True  # type: ignore[attr-defined]
                return response

            peer.node.create_service(srv.SetBool, name, switch)
        client = Client(peer, "/fib_mon", 1000)
        client.meet()
        goals = [client.goal(order) for order in (20, 60, 10)]
        results = [goal.get_result_async() for goal in goals if goal.accepted]
        answers = [peer.call(srv.SetBool, f"{name}_mon", srv.SetBool.Request(data=True)) for name in SWITCHES]
        assert [goal.accepted for goal in goals] == [True, False, True]
        assert [answer.success for answer in answers] == [False, True, True, True]
        assert [client.done(result).status for result in results] == [SUCCEEDED, SUCCEEDED]
        adapter.ends_well()
        session = scene.server.session("s")
        assert (session["counters"]["late"], session["counters"]["lost"]) == (0, 0)
        assert violated(scene, "s") == {"short", "off"}


class World:
    """Simulated time, which goes on while its node is spun."""

    def __init__(self, peer: Peer, seconds: float) -> None:
        self.seconds = seconds
        self._clock = peer.publisher(clock_msgs.Clock, "/clock")
        peer.node.create_timer(0.01, self.tick)

    def tick(self) -> None:
        self.seconds += 0.01
        stamp = time_msg.Time(sec=int(self.seconds), nanosec=round(self.seconds % 1 * SECOND) % SECOND)
        self._clock.publish(clock_msgs.Clock(clock=stamp))


def test_in_simulated_time_an_action_is_judged_by_it(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION))) as scene:
        adapter = scene.adapter("fib", more=("--ros-args", "-p", "use_sim_time:=true"))
        fibonacci(scene)
        peer = scene.peer()
        World(peer, 100)
        client = Client(peer, "/fib_mon", 1000)
        client.meet()
        goal, long = client.goal(3), client.goal(60)
        assert (goal.accepted, long.accepted) == (True, False)
        assert client.result(goal) == (SUCCEEDED, [0, 1, 2])
        adapter.ends_well()
        session, events = scene.server.session("s"), scene.server.events("s")
        assert (session["clock"], violated(scene, "s")) == ("sim", {"short"})
        assert {"goal", "reply", "feedback", "result"} <= {event["kind"] for event in events}
        assert all(100 * SECOND < event["stamp"] < 1000 * SECOND for event in events[-5:]), (
            "it has heard the clock by then"
        )


def test_results_of_a_server_that_was_killed_are_aborted_though_another_is_there(tmp_path: Path) -> None:
    with acting(tmp_path, streams("goal")) as scene:
        server, client = scene.server(), scene.client()
        goal = client.goal(400)
        result = goal.get_result_async()
        eventually(lambda: scene.judge.of("feedback"), lambda found: len(found) > 10)
        server.end(signal.SIGKILL)
        scene.server()
        assert client.done(result).status == ABORTED
        client.peer.until(lambda: client.goal(1).accepted)
        assert [e for e in scene.judge.of("result") if e["goal_id"] == hex_of(goal)] == []
        scene.adapter.ends_well()


def violated(scene: Scene, session: str) -> set[str]:
    return {p["id"] for p in scene.server.session(session)["properties"] if p["violations"]}
