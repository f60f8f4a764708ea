"""What `check` says of events of patterns, and of triggers, that keep their value."""

from __future__ import annotations

import pytest

from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: guarded
define: {go: '{mode: AUTO}', came: 'once {topic: /arm}', on: '{topic: /arm}', off: '{topic: /disarm}'}
streams:
  - {topic: /mode, signals: {mode: msg.mode, id: msg.id}, hold: [mode]}
  - {topic: /arm, signals: {id: msg.id}}
  - {topic: /disarm}
  - {topic: /cmd, signals: {speed: msg.v, id: msg.id}, action: filter}
derive:
  arm: {start: no, otherwise: stay, states: {no: {on: yes}, yes: {off: no}}}
  arm_age: {age: '{topic: /arm}'}
properties:
  - {id: p, pattern: 'PATTERN', guards: [/cmd]}
"""
CMD = '{topic: "/cmd"} -> '
AUTO = '{mode: "AUTO"}'


@pytest.mark.parametrize(
    ("pattern", "mend"),
    [
        ("/cmd requires {mode: AUTO}", CMD + AUTO),
        ("/cmd requires go", CMD + AUTO),
        ("/cmd requires (not go and {mode: *})", f"{CMD}not {AUTO} and {{mode: *}}"),
        ("/cmd requires {arm: yes}", f'{CMD}{{arm: "yes"}}'),
        ("/cmd requires {arm_age < 5}", f"{CMD}{{arm_age < 5}}"),
        ("go forbids /cmd", f"{CMD}not {AUTO}"),
        ("after /arm until /disarm: /cmd requires go", CMD + AUTO),
        ("while {arm: yes}: /cmd {speed > 1} requires go", '{topic: "/cmd", speed > 1} -> ' + AUTO),
        ("forall[i]. /cmd {id: *i} requires {mode: *i}", '{topic: "/cmd", id: *i} -> {mode: *i}'),
        ("/cmd requires go within 5s", None),
        ("/cmd requires /mode {mode: AUTO}", None),
        ("/cmd requires /arm", None),
        ("/cmd requires came", None),
        ("forall[i]. /cmd {id: *i} requires {id: *i, mode: AUTO}", None),
        ("no /cmd {speed > 9}", None),
    ],
)
def test_what_a_state_ever_was_is_told_of(pattern: str, mend: str | None) -> None:
    found = [w.message for w in parse_spec(SPEC.replace("PATTERN", pattern), "s.yaml").warnings]
    told = [each for each in found if "asks whether it ever held up to then" in each]
    assert len(told) == (mend is not None)
    assert all(f"to ask what holds then, write in its place `always {mend}`" in each for each in told)


@pytest.mark.parametrize(
    ("formula", "is_told"),
    [
        ("{topic: /cmd, speed > 0} -> once {mode: AUTO}", True),
        ("forall[i]. {topic: /cmd, id: *i} -> once {topic: /arm, id: *i} and once go", True),
        ("{topic: /cmd} -> {mode: AUTO}", False),
        ("{topic: /cmd} -> once {topic: /mode, mode: AUTO}", False),
        ("{topic: /cmd} -> once[:5] {mode: AUTO}", False),
        ("{topic: /cmd} -> not once {mode: FAULT}", False),
        ("{topic: /cmd} -> once {mode: *}", False),
        ("{topic: /cmd} -> once {arm: yes}", False),
    ],
)
def test_a_state_that_a_formula_asks_to_have_held_once_is_told_of(formula: str, *, is_told: bool) -> None:
    """An emergency stop that was released once would be released for good."""
    text = SPEC.replace("pattern: 'PATTERN'", f"formula: '{formula}'").replace(
        "'once {topic: /arm}'", "'{topic: /arm}'"
    )
    found = [w.message for w in parse_spec(text, "s.yaml").warnings if "holds for good" in w.message]
    assert len(found) == is_told
    assert all('write `{mode: "AUTO"}` alone' in w and "`once {topic: /mode, …}`" in w for w in found)


def test_the_mend_is_sound() -> None:
    pattern = "after /arm until /disarm: always {topic: /cmd} -> {mode: AUTO}"
    found = parse_spec(SPEC.replace("PATTERN", pattern), "s.yaml").warnings
    assert not [each for each in found if "asks whether" in each.message]


@pytest.mark.parametrize(
    ("prop", "is_told"),
    [
        ("pattern: '{mode: FAULT} causes /arm within 1s'", True),
        ("pattern: 'while {arm: no}: (go or {mode: FAULT}) causes /arm within 1s'", True),
        ("formula: 'go -> eventually[:5] {topic: /arm}'", True),
        ("pattern: '/mode {mode: FAULT} causes /arm within 1s'", False),
        ("formula: 'go and not pre go -> eventually[:5] {topic: /arm}'", False),
        ("formula: 'lasting[3] go -> eventually[:5] {topic: /arm}'", True),
        ("formula: '{topic: /cmd} and go -> eventually[:5] {topic: /arm}'", False),
        ("formula: '{topic: /cmd} and lasting[3] go -> eventually[:5] {topic: /arm}'", False),
        ("formula: 'go -> always[:5] not {topic: /arm}'", False),
        ("requirement: 'Whenever go the robot shall within 5 steps satisfy on'", False),
    ],
)
def test_a_trigger_that_keeps_its_value_asks_again(prop: str, *, is_told: bool) -> None:
    text = SPEC.replace("pattern: 'PATTERN', guards: [/cmd]", prop).replace(", action: filter", "")
    found = [w.message for w in parse_spec(text, "s.yaml").warnings if "asks for another answer each time" in w.message]
    assert len(found) == is_told
    assert all("`mode` keep" in each and "`{topic: /mode, …}`" in each for each in found)


@pytest.mark.parametrize(
    ("pattern", "is_told"),
    [
        ("/cmd requires /arm", True),
        ("/cmd requires /mode {mode: AUTO}", True),
        ("/cmd {id: 3} requires (/arm or /disarm)", True),
        ("globally: /cmd requires /arm", False),
        ("/cmd requires /arm within 5s", False),
        ("after /arm until /disarm: /cmd requires /arm", False),
        ("forall[i]. /cmd {id: *i} requires /arm {id: *i}", False),
        ("/arm forbids /cmd", False),
        ("/cmd requires {mode: AUTO}", False),
    ],
)
def test_what_the_first_cause_allows_for_good_is_told_of(pattern: str, is_told: bool) -> None:
    found = parse_spec(SPEC.replace("PATTERN", pattern), "s.yaml").warnings
    assert any("is enough for all that comes later" in each.message for each in found) is is_told
