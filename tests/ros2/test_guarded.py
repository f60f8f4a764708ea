"""An action that a real oracle guards, through the adapter, on real ROS 2."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import ROS_ONLY, SERVER, environment
from tests.robot import spec_folder
from tests.ros2.acting import ABORTED, DENIED, SUCCEEDED, Client, hex_of
from tests.ros2.harness import Scene, eventually

# rclpy imports an old lark with its first node, and warns by functions of its own that are deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

FIB = """
id: fib
description: Short goals, each with a result of its own
streams:
  - ros_action: /fib
    type: test_msgs/action/Fibonacci
    action: filter
    ask: [goal, result]
    decide_within: 60s
    denied_result: {sequence: [9, 9]}
    goal: {signals: {order: msg.order}}
    reply: {}
    feedback: {}
    result: {signals: {length: size(msg.sequence)}}
    status: {}
properties:
  - id: short
    formula: 'not {ros_action: "/fib", kind: goal, order > 50}'
    guards: [/fib]
  - id: not_five
    formula: 'not {ros_action: "/fib", kind: result, length: 5}'
    guards: [/fib]
  - id: result_has_goal
    formula: 'forall[g]. {kind: result, goal_id: *g} -> once{kind: goal, goal_id: *g}'
"""


def test_goals_and_results_are_decided_on_and_all_is_in_the_history(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, FIB)) as scene:
        adapter = scene.adapter("fib")
        server = scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", 0.01)
        server.said("ready")
        client = Client(scene.peer(), "/fib_mon", 1000)
        goal, long, five = client.goal(3), client.goal(60), client.goal(5)
        assert [one.accepted for one in (goal, long, five)] == [True, False, True]
        assert client.result(goal) == (SUCCEEDED, [0, 1, 2])
        assert client.result(five) == (ABORTED, DENIED["sequence"])
        assert "goal 60" not in server.log
        adapter.ends_well()
        events = eventually(
            lambda: scene.server.events("s"),
            lambda found: all(event["passed"] is not None for event in found if event["kind"] in ("goal", "result")),
        )
        told = [(e["kind"], e["passed"]) for e in events if e["kind"] in ("goal", "result")]
        assert sorted(told) == [("goal", False), ("goal", True), ("goal", True), ("result", False), ("result", True)]
        counters = scene.server.session("s")["counters"]
        assert (counters["lost"], counters["late"]) == (0, 0)


def test_two_monitors_on_one_action_guard_it_one_after_the_other(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, FIB)) as scene:
        inner = scene.adapter("fib", session="inner", monitor="inner")
        more = ("--remap", "/fib:=/fib_mon")
        outer = scene.adapter("fib", session="outer", monitor="outer", more=more)
        server = scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", 0.01)
        server.said("ready")
        client = Client(scene.peer(), "/fib_mon_mon", 1000)
        client.peer.until(lambda: client.goal(1).accepted)
        goal, long = client.goal(3), client.goal(60)
        assert (goal.accepted, long.accepted) == (True, False)
        assert client.result(goal) == (SUCCEEDED, [0, 1, 2])
        client.peer.until(lambda: len(client.heard[hex_of(goal)]) == 3)
        for adapter, session, denied in ((outer, "outer", 1), (inner, "inner", 0)):
            adapter.ends_well()
            passed = [e["passed"] for e in scene.server.events(session) if e["kind"] == "goal"]
            assert passed.count(False) == denied, "what the outer one denies the inner one never sees"
            assert passed.count(True) >= 2


def test_without_an_oracle_all_passes_into_a_log_that_is_replayed(tmp_path: Path) -> None:
    folder, log, listed = spec_folder(tmp_path, FIB), tmp_path / "log.jsonl", tmp_path / "streams.json"
    command = [SERVER, "streams", folder / "spec.yaml"]
    described = subprocess.run(command, env=environment(ROS_ONLY), stdout=subprocess.PIPE, text=True, check=True)
    listed.write_text(described.stdout)
    with Scene(tmp_path / "scene", folder) as scene:
        adapter = scene.run(
            "adapter", sys.executable, "-m", "oracle_ros2", "--log", log, "--streams", listed, "--monitor", "uav1"
        )
        adapter.said("observing 5 streams")
        scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", 0.01).said("ready")
        client = Client(scene.peer(), "/fib_mon", 1000)
        client.meet()
        goal = client.goal(60)
        assert client.result(goal) == (SUCCEEDED, list(range(60)))
        adapter.ends_well()
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        mine = [line for line in lines if line["goal_id"] == hex_of(goal)]
        assert {line["kind"] for line in mine} == {"goal", "reply", "feedback", "result", "status"}
        assert [line["status"] for line in mine if line["kind"] == "reply"] == ["accepted"]
        replayed = scene.run("replay", SERVER, "replay", folder / "spec.yaml", log)
        replayed.said("1 violation")
