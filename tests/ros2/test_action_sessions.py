"""An action in a session of a real oracle, with what else there may be: services, simulated time, servers that die."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from tests.adapters.standin import SWITCHES
from tests.processes import Process
from tests.robot import spec_folder
from tests.ros2.acting import ABORTED, CANCELED, SUCCEEDED, Client, acting, hex_of, streams
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


def fibonacci(scene: Scene, period: float = 0.01) -> Process:
    server = scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", period)
    server.said("ready")
    return server


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
        sec, nanosec = divmod(round(self.seconds * SECOND), SECOND)  # rounded first: 10.999… is not 10.000
        stamp = time_msg.Time(sec=sec, nanosec=nanosec)
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


SLOW = """
  - topic: /slow
    type: std_msgs/msg/Empty
    latency: 200s"""
"""A topic for whose clock all decisions wait, 200 s of simulated time."""


def test_a_clock_that_goes_back_in_a_goal_begins_another_session_and_the_goal_goes_on(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION))) as scene:
        adapter = scene.adapter("fib", more=("--ros-args", "-p", "use_sim_time:=true"))
        fibonacci(scene, 0.2)
        peer = scene.peer()
        world = World(peer, 100)
        client = Client(peer, "/fib_mon", 1000)
        client.meet()
        goal = client.goal(50)
        result = goal.get_result_async()
        peer.until(lambda: client.heard.get(hex_of(goal)))
        world.seconds = 10
        peer.until(lambda: "attached s.run2" in adapter.log)
        before = len(client.heard[hex_of(goal)])
        peer.until(lambda: len(client.heard[hex_of(goal)]) > before, "no more feedback comes")
        assert client.done(goal.cancel_goal_async()).return_code == 0
        assert client.done(result).status == CANCELED
        later, long = client.goal(3), client.goal(60)
        assert (later.accepted, long.accepted) == (True, False)
        assert client.result(later) == (SUCCEEDED, [0, 1, 2])
        adapter.ends_well()
        first, second = scene.server.session("s"), scene.server.session("s.run2")
        assert (first["status"], first["continued_by"]) == ("closed", "s.run2")
        assert violated(scene, "s") == set()
        # what it feeds back there has no reply in this session
        assert violated(scene, "s.run2") == {"short", "feedback_has_a_reply"}
        assert all(session["counters"]["lost"] == 0 for session in (first, second))
        events = scene.server.events("s.run2")
        assert all(e["stamp"] < 100 * SECOND for e in events)
        assert not any(e["late"] or e["skewed"] for e in events)


def test_goals_that_wait_for_their_decision_as_the_clock_goes_back_do_not_pass_by_accident(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, spec(ACTION, SLOW))) as scene:
        adapter = scene.adapter("fib", more=("--ros-args", "-p", "use_sim_time:=true"))
        server = fibonacci(scene)
        peer = scene.peer()
        world = World(peer, 1000)
        client = Client(peer, "/fib_mon", 1000)
        peer.until(lambda: reached(scene) > 1000 * SECOND, "the adapter hears no clock")
        sent = [client.send(60), client.send(3)]
        peer.until(lambda: scene.server.session("s")["counters"]["held"] == 2)
        assert not any(goal.done() for goal in sent)
        world.seconds = 10
        assert [client.done(goal).accepted for goal in sent] == [False, True], "as the session that ends decides"
        server.said("goal 3")
        adapter.ends_well()
        assert "goal 60" not in server.log
        assert violated(scene, "s") == {"short"}


def reached(scene: Scene) -> int:
    """How far the goals of a session have come, in its time."""
    return max((s["frontier"] or 0 for s in scene.server.session("s")["streams"] if s["kind"] == "goal"), default=0)


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
