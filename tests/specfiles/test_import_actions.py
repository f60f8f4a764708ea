"""`import` of actions: those that a configuration names, and those whose hidden services it names."""

from __future__ import annotations

from pathlib import Path

from oracle_server.core.spec import Spec
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.rosmonitoring.write import import_config

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
