"""`import` of actions: those that a configuration names, and those whose hidden services it names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.spec import Spec
from oracle_server.core.verdicts import Outcome
from oracle_server.replay.run import Replay
from oracle_server.replay.traces.jsonl import read_lines
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.rosmonitoring.write import import_config
from tests.specfiles.original import judged

ACTIONS = """
monitors:
  - monitor:
      id: nav
      oracle: {port: 8080, url: 127.0.0.1, action: nothing}
      actions:
        - {name: fibonacci, type: example_interfaces.action.Fibonacci, action: filter}
        - {name: /dock, type: dock_msgs/action/Dock, action: log,
           event_kind: [start_action_request, cancel_action_request, cancel_action_response, status]}
"""
HIDDEN = """
monitors:
  - monitor:
      id: nav
      oracle: {port: 8080, url: 127.0.0.1, action: nothing}
      topics:
        - {name: /arm, type: std_msgs/Bool, action: log}
        - {name: /spin/_action/feedback, type: nav2_msgs.action.Spin_FeedbackMessage, action: log}
        - {name: /spin/_action/status, type: action_msgs.msg.GoalStatusArray, action: log}
      services:
        - {name: /spin/_action/send_goal, type: nav2_msgs.action.Spin_SendGoal, action: filter}
        - {name: /spin/_action/get_result, type: nav2_msgs.action.Spin_GetResult, action: log}
        - {name: /SetLED, type: uav_msgs.srv.SetLED, action: log}
"""
MODULE = """
PROPERTY = r"historically ({fast: True} -> once ({stowed: True} or {done: True} or {same: True} or {near: True}))"

predicates = dict(time=0, fast=False, stowed=False, done=False, same=False, near=False)

def abstract_message(message):
    if 'service' in message and message['service'] == '/spin/_action/send_goal' and 'request' in message:
        predicates['fast'] = message['request']['goal']['speed'] > 2
        predicates['same'] = message['request']['goal_id']['tag'] == 7
    elif 'service' in message and message['service'] == '/spin/_action/get_result' and 'response' in message:
        predicates['done'] = message['response']['result']['error_code'] == 0
    elif 'topic' in message and message['topic'] == '/spin/_action/feedback':
        predicates['near'] = message['feedback']['left'] < 1
    elif 'topic' in message and message['topic'] == '/arm':
        predicates['stowed'] = message['data']
    return predicates
"""


def imported(folder: Path, config: str, *modules: str) -> tuple[str, Spec]:
    """The text of a configuration's spec, and what it says."""
    path, out = folder / "config.yaml", folder / "spec.yaml"
    path.write_text(config)
    paths = []
    for number, text in enumerate(modules):
        paths.append(folder / f"module_{number}.py")
        paths[-1].write_text(text)
    found = import_config(path, paths, out, Types((), {}))
    assert not found.refused, found.findings
    text = out.read_text()
    return text, parse_spec(text, "spec.yaml").spec


def kinds(spec: Spec, name: str) -> dict[str, str]:
    return {stream.kind: stream.action for stream in spec.streams if stream.name == name}


def test_actions_are_observed_by_the_kinds_of_their_events(tmp_path: Path) -> None:
    text, spec = imported(tmp_path, ACTIONS)
    assert kinds(spec, "/fibonacci") == {
        "goal": "filter", "reply": "filter", "feedback": "log", "cancel": "log", "result": "filter"
    }  # fmt: skip
    assert kinds(spec, "/dock") == dict.fromkeys(("goal", "cancel", "status"), "log")
    assert {stream.type for stream in spec.streams} == {
        "example_interfaces/action/Fibonacci", "dock_msgs/action/Dock"
    }  # fmt: skip
    assert spec.properties[0].guards == {"/fibonacci"}
    assert "no counterpart" not in text


def test_hidden_services_of_an_action_are_its_goals_replies_and_results(tmp_path: Path) -> None:
    text, spec = imported(tmp_path, HIDDEN)
    assert kinds(spec, "/spin") == {"goal": "filter", "reply": "filter", "feedback": "log", "result": "log"}
    assert kinds(spec, "/SetLED") == dict.fromkeys(("request", "response"), "log")
    assert kinds(spec, "/spin/_action/status") == {"topic": "log"}, "a topic that can be read as it is"
    assert "type: nav2_msgs/action/Spin\n" in text


def test_what_a_module_reads_of_hidden_services_is_read_of_the_inner_message_or_left_to_be_written(
    tmp_path: Path,
) -> None:
    text, spec = imported(tmp_path, HIDDEN, MODULE)
    signals = {stream.kind: dict(stream.signals or {}) for stream in spec.streams if stream.name == "/spin"}
    assert signals["goal"]["fast"] == "msg.speed > 2"
    assert signals["feedback"] == {"near": "msg.left < 1"}
    assert signals["result"] == {"done": "msg.error_code in [false, 0]"}, "as Python compares"
    assert signals["goal"].get("same", "todo()") == "todo()", "an envelope can't be read"
    assert signals["reply"] == {}
    (held,) = (stream.hold for stream in spec.streams if stream.kind == "result")
    assert held == {"done"}, "what its module keeps from event to event"
    assert spec.properties[0].guards == {"/spin"}
    assert "goal_id.tag" not in "".join(line for line in text.splitlines() if not line.lstrip().startswith("#"))


DOCK = """
monitors:
  - monitor:
      id: m
      topics:
        - {name: a, type: std_msgs.msg.Bool, action: log}
        - {name: b, type: std_msgs.msg.Bool, action: log}
      actions:
        - {name: dock, type: dock_msgs/action/Dock, action: filter}
"""
FINE = "PROPERTY = '{x}'\npredicates = dict(x=True)\ndef abstract_message(m):\n return predicates\n"
STARTS = "predicates = dict(p=True, q=False)\ndef abstract_message(message):\n"
A, B, GOAL, FEEDBACK = "a", "b", "goal", "feedback"


@pytest.mark.parametrize(
    ("formula", "body", "trace"),
    [
        ("not {q}", "if message.get('topic') == 'a':\n  predicates['q'] = message['data']", [(A, True), (GOAL, 3)]),
        ("{p}", "if message.get('topic') == 'a':\n  predicates['p'] = message['data']", [(FEEDBACK, 1), (GOAL, 2)]),
        ("historically{p}", "pass", [(A, True), (FEEDBACK, 2), (GOAL, 1)]),
        (
            "{p} and not {q}",
            "if 'topic' in message:\n  predicates['q' if message['topic'] == 'b' else 'p'] = message['data']",
            [(GOAL, 1), (A, False), (GOAL, 1), (A, True), (GOAL, 1), (B, True), (FEEDBACK, 1), (B, False), (GOAL, 1)],
        ),
        (
            "{p} and not {q}",
            "topic = message.get('topic')\n if topic == 'a':\n  predicates['p'] = message['data']\n"
            " elif topic == 'b':\n  predicates['p'] = not message['data']\n else:\n  predicates['q'] = True",
            [(A, False), (GOAL, 1), (B, False), (A, True), (GOAL, 1)],
        ),
    ],
)  # fmt: skip
def test_a_predicate_is_kept_until_an_event_of_an_action(
    tmp_path: Path, formula: str, body: str, trace: list[tuple[str, object]]
) -> None:
    """The original keeps it at whatever message sets nothing: what was said of a topic is asked when a goal comes."""
    without_b = "".join(line for line in DOCK.splitlines(keepends=True) if "name: b" not in line)
    config = DOCK if any(name == B for name, _ in trace) else without_b
    text, spec = imported(tmp_path, config, f"PROPERTY = r'{formula}'\n{STARTS} {body}\n return predicates\n")
    (original,) = judged(tmp_path / "module_0.py", [[_of_original(*event, time=n) for n, event in enumerate(trace)]])
    assert _said(tmp_path, spec, trace) == original, text
    assert "TODO" not in "".join(text.splitlines()[1:])


@pytest.mark.parametrize(
    ("body", "also"),
    [
        ("predicates['p'] = message.get('action') == 'dock'", ""),
        ("if 'goal' in message:\n  predicates['p'] = message['goal']['left'] > 2", ""),
        ("if message.get('topic') != 'a':\n  predicates['p'] = message['left'] > 2", ""),
        ("predicates['p'] = message['topic'] == 'a'", "the module fails here"),
    ],
)
def test_what_a_module_reads_of_an_action_is_unknown_until_it_is_written(tmp_path: Path, body: str, also: str) -> None:
    text, spec = imported(tmp_path, DOCK, f"PROPERTY = r'{{p}}'\n{STARTS} {body}\n return predicates\n")
    assert _said(tmp_path, spec, [(GOAL, 3), (FEEDBACK, 3)]) == [None, None]
    assert ("TODO: write this" in text) != bool(also)
    assert also in text


def test_a_formula_that_cannot_be_read_is_unknown_at_events_of_actions_too(tmp_path: Path) -> None:
    _, spec = imported(tmp_path, DOCK, f"PROPERTY = r'{{p}} -> {{q}} -> {{p}}'\n{STARTS} return predicates\n", FINE)
    assert _said(tmp_path, spec, [(A, True), (GOAL, 3)]) == [None, None]


def _of_original(name: str, data: object, *, time: int) -> dict[str, Any]:
    if name in (A, B):
        return {"topic": name, "time": time, "data": data}
    return {"action": "dock", "time": time, name: {"left": data}}


def _said(folder: Path, spec: Spec, trace: list[tuple[str, object]]) -> list[bool | None]:
    """What the first property says of each event, None for unknown."""
    lines = []
    for n, (name, data) in enumerate(trace):
        if name in (A, B):
            lines.append({"topic": name, "time": n, "data": data})
        else:
            lines.append({"ros_action": "/dock", "kind": name, "goal_id": "0" * 32, "time": n, "data": {"left": data}})
    path = folder / "trace.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = [j.verdicts[0].outcome for j in Replay(spec, read_lines(path, spec), "arrival") if j.number is not None]
    return [None if o is Outcome.UNKNOWN else o in (Outcome.TRUE, Outcome.CURRENTLY_TRUE) for o in found]
