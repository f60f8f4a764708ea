"""Actions in specs, by their types and by the version of ROS, and what is sent of them to adapters."""

from __future__ import annotations

from pathlib import Path

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.core.hazards.ros import Ros
from oracle_server.core.plan import plan
from oracle_server.rostypes.known import Types
from oracle_server.sessions.greeting import stream_frame
from oracle_server.specfiles.load import parse_spec

ACTION = "float64 x\n---\nint32 code\n---\nfloat64 left\n"
SPEC = """
id: driving
streams:
  - ros_action: /drive
    type: bases/Drive
    action: filter
    ask: [goal, cancel]
    denied_result: {code: 9}
    goal: {signals: {x: msg.x}}
    reply: {signals: {taken: msg.accepted}}
    feedback: {hold: [left], ordered: false}
    cancel: {signals: {since: msg.stamp.sec}}
    result: {signals: {code: msg.code}}
properties:
  - {id: near, formula: '{ros_action: /drive, kind: goal} -> {x < 10}', guards: [/drive], blame: any}
  - {id: arrived, formula: '{ros_action: /drive, kind: result, status: succeeded} -> {left < 1}'}
"""


def found(folder: Path, text: str, ros: Ros | None = None) -> list[str]:
    """What is wrong or doubtful, without what is meant here."""
    (folder / "bases" / "action").mkdir(parents=True, exist_ok=True)
    (folder / "bases" / "action" / "Drive.action").write_text(ACTION)
    try:
        said = parse_spec(text, "s.yaml", ros, types=Types([folder], {})).warnings
    except SpecError as error:
        said = error.findings
    return [one.message for one in said if not one.message.startswith(("`cancel` is asked", "`denied_result` has no"))]


@pytest.mark.parametrize("ros", [None, 1, 2])
def test_the_types_of_an_action_are_those_of_its_parts_on_both_versions_of_ros(tmp_path: Path, ros: Ros | None) -> None:
    assert found(tmp_path, SPEC, ros) == []
    assert found(tmp_path, SPEC.replace("msg.code", "msg.cod"), ros) == [
        "signal 'code': bases/action/Drive has no field `cod`; did you mean `code`? it has code"
    ]
    assert found(tmp_path, SPEC.replace("[left]", "[lft]").replace("{left", "{lft"), ros)[0] == (
        "'lft' is held: bases/action/Drive has no field `lft`; did you mean `left`? it has left"
    )
    assert found(tmp_path, SPEC.replace("{code: 9}", "{code: nine}"), ros) == [
        "denied_result of /drive: 'nine' does not fit `code`, which is of the type int32"
    ]
    assert found(tmp_path, SPEC.replace("bases/Drive", "bases/Driv"), ros) == [
        "the package bases has no action 'Driv'; did you mean `Drive`?"
    ]
    assert found(tmp_path, SPEC.replace("msg.accepted", "msg.acepted"), ros)[0].startswith(
        "signal 'taken': the reply to a goal has no field `acepted`; did you mean `accepted`?"
    )


def test_a_cancel_has_the_fields_of_its_version_of_ros(tmp_path: Path) -> None:
    by_id = SPEC.replace("since: msg.stamp.sec", "since: msg.id")
    assert found(tmp_path, by_id, 1) == []
    assert len(found(tmp_path, by_id, 2)) == 1
    assert "another version of ROS has it" in found(tmp_path, by_id)[0]


def test_a_reply_that_is_asked_is_doubtful_where_there_is_none(tmp_path: Path) -> None:
    asked = SPEC.replace("[goal, cancel]", "[goal, reply]")
    (said,) = found(tmp_path, asked, 1)
    assert said.startswith("`reply` is asked: ROS 1 has no replies to goals")
    assert found(tmp_path, asked, 2) == []


def test_a_cancel_passes_while_the_oracle_is_away_and_what_is_not_asked_is_logged() -> None:
    ready = plan(parse_spec(SPEC, "s.yaml").spec)
    frames = {key.kind: stream_frame(ready, key) for key in ready.streams}
    assert {kind: (frame["action"], frame.get("on_unavailable")) for kind, frame in frames.items()} == {
        "goal": ("filter", "deny"), "reply": ("log", None), "feedback": ("log", None), "cancel": ("filter", "pass"),
        "result": ("log", None),
    }  # fmt: skip
    assert {(frame["proxy"], frame["via"]) for frame in frames.values()} == {("/drive_mon", "proxy")}
    assert [frame["denied_result"] for frame in frames.values()] == [{"code": 9}] * 5
    assert not any({"intercept", "denied_response"} & frame.keys() for frame in frames.values())


def test_what_is_only_heard_of_has_no_proxy() -> None:
    text = SPEC.replace("action: filter\n    ask: [goal, cancel]", "via: introspection").replace(
        ", guards: [/drive]", ""
    )
    ready = plan(parse_spec(text, "s.yaml").spec)
    assert {(stream_frame(ready, key)["proxy"], stream_frame(ready, key)["via"]) for key in ready.streams} == {
        (None, "introspection")
    }
    assert not any(stream.proxied for stream in ready.spec.streams), "its clocks lag by the latency, as a topic's"


def test_specs_without_actions_mean_what_they_meant() -> None:
    text = (
        "id: s\nstreams:\n  - {topic: /a, signals: {status: msg.s}}\nproperties:\n  - {id: p, formula: '{status: 1}'}\n"
    )
    digest = "249db84718bd"
    assert parse_spec(text, "s.yaml").spec.digest.startswith(digest), "as the versions before gave it"
