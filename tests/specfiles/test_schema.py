"""The schema for editors takes what `check` takes, and refuses what is misspelt."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from oracle_server.core.errors import SpecError
from oracle_server.specfiles.load import load_spec, parse_spec
from oracle_server.specfiles.model import SpecModel
from oracle_server.specfiles.schema import DESCRIPTIONS, description, spec_schema
from tests.processes import ROOT

SCHEMA = spec_schema()
VALIDATOR = Draft202012Validator(SCHEMA)
SPECS = sorted(
    path
    for folder in ("specs", "examples", "tests", "benchmarks")
    for path in (ROOT / folder).rglob("*.yaml")
    if "streams:" in path.read_text(encoding="utf-8") and "properties:" in path.read_text(encoding="utf-8")
)
SOUND = """
id: s
ordering: {by: publication, max_delay: none, late: revise, horizon: 1.5s, max_skew: 1s, capacity: 100}
retention: {age: 168h, events: 10, size: 500MB}
episodes: {gap: 500ms}
close: after 1h
streams:
  - topic: /a
    type: std_msgs/Bool
    stamp: header.stamp
    signals: {a: msg.data}
    hold: [a]
  - topic: /b
    type: std_msgs.msg.Bool
    stamp: {field: t, unit: us, epoch: boot}
    action: filter
    decide_within: 3s
  - service: /c
    type: std_srvs/srv/SetBool
    denied_response: {success: false}
    request: {signals: {on: msg.data}}
  - ros_action: /d
    action: filter
    ask: [goal, cancel]
    goal: {signals: {x: msg.x}}
    result:
define: {up: '{a}'}
derive:
  twice: a + a
  often: {rate: '{a}', over: 2s}
  top: {max: x, over: 20}
  modes: {follows: x, states: {A: [B, 1], B: [A], 1: []}}
  nav: {by: x, forget: 1h, start: s, states: {s: {up: t, within: 3s, leave: true}, t: {}}, otherwise: stay}
  turns: {sequence: 'up*'}
properties:
  - {id: p, formula: '{a}', time: seconds, guards: [/b], latch: true, at_end: violated}
  - {id: says, pattern: '/a causes /b within 5s'}
  - {id: asks, requirement: 'when up the robot shall within 5 steps satisfy up'}
  - {id: m, machine: modes}
  - {id: q, engine: external, url: 'ws://127.0.0.1:1', timeout: 100ms, streams: [/a], names: bare}
"""
UNSOUND = {
    "id: s": "id: s s",
    "by: publication": "by: publicaton",
    "max_delay: none": "max_delay: 200",
    "max_delay: none,": "max_delay: 20 ms,",
    "late: revise": "late: revised",
    "horizon: 1.5s": "horizons: 1.5s",
    "max_skew: 1s": "max_skew: [1s]",
    "capacity: 100": "capacity: 0",
    "age: 168h": "age: 7d",
    "events: 10": "events: 10.5",
    "size: 500MB": "size: 500",
    "gap: 500ms": "gap: 0.5",
    "close: after 1h": "close: 1h",
    "topic: /a": "topics: /a",
    "type: std_msgs/Bool": "type: Bool",
    "stamp: header.stamp": "stamp: header stamp",
    "signals: {a: msg.data}": "signals: [a]",
    "hold: [a]": "hold: a",
    "unit: us": "unit: usec",
    "epoch: boot": "epoch: start",
    "action: filter": "action: filtered",
    "decide_within: 3s": "decide_within: 3",
    "denied_response: {success: false}": "denied_response: no",
    "request: {": "requests: {",
    "ask: [goal, cancel]": "ask: [goals]",
    "goal: {signals": "goal: {signal",
    "define: {up: '{a}'}": "define: up",
    "over: 2s": "over: 2 s",
    "over: 20": "over: 0",
    "states: {A: [B, 1]": "states: {A: B",
    "follows: x": "follows: [x]",
    "start: s": "start: [s]",
    "sequence: 'up*'": "sequence: [up]",
    "machine: modes": "machine: [modes]",
    "time: seconds": "time: second",
    "latch: true": "latch: 1",
    "at_end: violated": "at_end: violate",
    "engine: external": "engine: other",
    "url: 'ws:": "url: 'http:",
    "names: bare": "names: short",
    "guards: [/b]": "guards: /b",
    "properties:": "property:",
    "formula: '{a}',": "formulas: '{a}',",
}


def found(text: str) -> list[Any]:
    return list(VALIDATOR.iter_errors(yaml.safe_load(text)))


def refused(text: str) -> bool:
    try:
        parse_spec(text, "s.yaml")
    except SpecError:
        return True
    return False


def test_it_is_a_schema_and_the_published_one() -> None:
    Draft202012Validator.check_schema(SCHEMA)
    published = json.loads((ROOT / "docs/spec.schema.json").read_text(encoding="utf-8"))
    assert published == SCHEMA, "write it anew: oracle-server schema > docs/spec.schema.json"


def test_each_key_is_described_and_nothing_else() -> None:
    plain = SpecModel.model_json_schema()
    models = {"SpecModel": plain, **plain["$defs"]}
    keys = {(name, key) for name, model in models.items() for key in model["properties"]}
    assert all(description(*key) for key in keys)
    used = {name for model, key in keys for name in (f"{model}.{key}", key)}
    assert not set(DESCRIPTIONS) - used


def test_it_takes_what_check_takes() -> None:
    sound = 0
    for path in SPECS:
        with suppress(SpecError):
            load_spec(path)
            sound += 1
            assert not found(path.read_text(encoding="utf-8")), path
    assert sound > 100


def test_a_spec_with_all_keys_is_taken() -> None:
    assert not found(SOUND)


@pytest.mark.parametrize("right", UNSOUND)
def test_what_check_refuses_of_a_key_is_refused(right: str) -> None:
    assert SOUND.count(right) >= 1
    wrong = SOUND.replace(right, UNSOUND[right], 1)
    assert found(wrong)
    assert refused(wrong)


def test_defaults_are_written_as_people_write_them() -> None:
    models = SCHEMA["$defs"]
    assert models["OrderingModel"]["properties"]["max_delay"]["default"] == "200ms"
    assert models["TopicModel"]["properties"]["decide_within"]["default"] == "2s"
    assert models["OrderingModel"]["properties"]["capacity"]["default"] == 10_000
