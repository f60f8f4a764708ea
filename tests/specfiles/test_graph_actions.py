"""A dump of a ROS graph has actions by the names beneath them; `check` knows who sends goals to which."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.rosgraph import load_graph

SPEC = """
id: moving
ordering: {max_delay: none}
streams:
  - ros_action: /move
    action: filter
    goal: {}
  - {topic: /arm, signals: {stowed: msg.data}, hold: [stowed]}
properties:
  - {id: p, formula: '{ros_action: /move, kind: goal} -> {stowed}', guards: [/move], blame: any}
"""
SEND, GOAL = {"/move/_action/send_goal": ["m/action/Move_SendGoal"]}, {"/move/goal": ["m/MoveActionGoal"]}
ARM = {"/arm": ["std_msgs/msg/Bool"]}


def found(tmp_path: Path, *nodes: dict[str, object]) -> str:
    """What `check` says of the spec on a robot of these nodes."""
    path = tmp_path / "graph.json"
    path.write_text(json.dumps({"nodes": [{"name": f"/n{i}", **node} for i, node in enumerate(nodes)]}))
    try:
        return "\n".join(map(str, parse_spec(SPEC, "s.yaml", graph=load_graph(path)).warnings))
    except SpecError as error:
        return str(error)


@pytest.mark.parametrize("sends", [{"calls": SEND}, {"publishes": GOAL}])
def test_a_client_of_an_action_sends_goals_to_it(tmp_path: Path, sends: dict[str, object]) -> None:
    assert "starvation" not in found(tmp_path, sends, {"publishes": ARM})
    assert "no node of the graph sends goals to /move" in found(tmp_path, {"publishes": ARM})
    assert "no node of the graph sends goals to /move" in found(
        tmp_path, {"publishes": {"/move/goal": ["std_msgs/Bool"]}}
    )


@pytest.mark.parametrize(
    ("serves", "sends"), [({"serves": SEND}, {"calls": SEND}), ({"subscribes": GOAL}, {"publishes": GOAL})]
)
def test_what_a_server_publishes_once_it_has_a_goal_depends_on_the_goal(
    tmp_path: Path, serves: dict[str, object], sends: dict[str, object]
) -> None:
    told = found(tmp_path, sends, {**serves, "publishes": ARM})
    assert "deadlock: /move -> /arm -> /move" in told
    proxied: dict[str, object] = {
        "serves": {"/move_mon/_action/send_goal": ["m/action/Move_SendGoal"]},
        "calls": SEND,
        "publishes": ARM,
    }
    assert "deadlock" not in found(tmp_path, sends, proxied), "a monitor forwards, and causes nothing"
