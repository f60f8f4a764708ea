"""What `check` says of a text without quotes that is the name of a signal or a variable: it is compared as a text."""

from __future__ import annotations

import pytest

from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: t
streams:
  - {{topic: /odom, signals: {{speed: msg.speed, mode: msg.mode}}}}
  - {{topic: /limit, signals: {{limit: msg.data}}, hold: [limit]}}
  - {{topic: /state, type: std_msgs/msg/String, signals: {{state: msg.data}}, hold: [state]}}
  - {{topic: /on, type: std_msgs/msg/Bool, signals: {{charging: msg.data}}, hold: [charging]}}
  - {{topic: /n, type: std_msgs/msg/Int32, signals: {{level: 'msg.data > 2 ? "high" : "limit"'}}}}
derive:
  before: {{previous: speed}}
{derive}properties:
  - {{id: p, formula: '{{topic: /odom}} -> {{speed > before}}'}}
  - {{id: q, formula: '{formula}'}}
"""


def told(formula: str, derive: str = "") -> list[str]:
    found = parse_spec(SPEC.format(formula=formula, derive=derive), "s.yaml", types=Types([], {})).warnings
    return [str(each) for each in found if " asks for the text " in each.message]


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        ("{topic: /odom} -> {speed == limit}", "speed: limit"),
        ("{topic: /odom} -> {speed = limit}", "speed: limit"),
        ("not {topic: /odom, speed: before}", "speed: before"),
        ("forall[m]. {mode: *m, speed != limit} -> once {state: *m}", "speed != limit"),
        ("{mode: GO} -> eventually[:5] {mode: state}", "mode: state"),
    ],
)
def test_an_equality_with_a_signals_name_is_told_of(formula: str, text: str) -> None:
    (found,) = told(formula)
    key, name = text.replace(" !=", ":").split(": ")
    assert f"warning: formula of 'q': `{text}` asks for the text \"{name}\", and not for the value of the" in found
    assert f"`same: {key} == {name}` under `derive`" in found


@pytest.mark.parametrize(
    ("formula", "atom", "mend"),
    [
        ("not {mode: True}", "mode: True", "a Boolean is written `true`"),
        ("{topic: /odom} -> {mode != FALSE}", "mode != FALSE", "a Boolean is written `false`"),
        ("not {speed: inf}", "speed: inf", "a signal is never NaN or infinite, since it then fails, and what reads it"),
        ("not {mode: None}", "mode: None", "which no atom is true of: write `not {mode: *}`"),
    ],
)
def test_a_word_for_a_value_of_another_language_is_told_of(formula: str, atom: str, mend: str) -> None:
    (found,) = told(formula)
    assert f"warning: formula of 'q': `{atom}` asks for the text" in found
    assert mend in found


@pytest.mark.parametrize(
    ("formula", "atom"),
    [
        ("forall[m]. {topic: /odom, mode: *m} -> not once {topic: /state, state: m}", "state: m"),
        ("forall[m]. {mode: *m} -> eventually[:5] {state: m}", "state: m"),
        ("exists[m]. {mode: *m, speed != m}", "speed != m"),
        ("forall[state]. {mode: *state} -> once {state: state}", "state: state"),
    ],
)
def test_a_variable_without_its_star_is_told_of(formula: str, atom: str) -> None:
    (found,) = told(formula)
    name = atom[-1] if atom != "state: state" else "state"
    assert f"warning: formula of 'q': `{atom}` asks for the text \"{name}\", and not for the value of the var" in found
    assert f"write `*{name}`" in found


def test_a_variable_without_its_star_is_told_of_in_a_sentence() -> None:
    text = SPEC.format(formula="{mode: *}", derive="").replace(
        "formula: '{mode: *}'", "pattern: 'forall[m]. /odom {mode: *m} causes /state {state: m} within 5s'"
    )
    found = [str(each) for each in parse_spec(text, "s.yaml").warnings if "write `*m`" in each.message]
    assert len(found) == 1


@pytest.mark.parametrize(
    "formula",
    [
        'forall[m]. {topic: /odom, mode: *m} -> not once {topic: /state, state: "m"}',
        'not {mode: "True"}',
        "not {topic: /state, state: None}",  # a text alone
        "{mode: NONE} -> {speed: 0}",  # so robots call it
        "not {topic: /odom, mode: none}",
        "{topic: /odom} -> {speed: true}",
        '{topic: /odom} -> {speed == "limit"}',  # in quotes it is meant
        "{topic: /odom} -> {mode: high}",
        "{topic: /odom, mode: mode} -> {speed > limit}",
        "{topic: /state} -> {state: charging}",  # a text is never a Boolean
        "{topic: /n} -> {level: limit}",  # the signal has this text
        "forall[limit]. {speed: *limit} -> once {mode: *limit}",
    ],
)
def test_nothing_is_said_of_what_can_only_be_a_text(formula: str) -> None:
    assert told(formula) == []


def test_a_derived_signals_formula_is_told_of_too() -> None:
    (found,) = told("{topic: /odom} -> {same_speed: 1}", "  same_speed: {count: '{speed: before}', over: 2s}\n")
    assert "s.yaml:10:" in found
    assert "warning: derived signal 'same_speed': `speed: before` asks for the text \"before\"" in found


def test_what_is_advised_compares_the_signals() -> None:
    spec = SPEC.format(formula="{topic: /odom} -> {same}", derive="  same: speed == limit\n")
    assert parse_spec(spec, "s.yaml", types=Types([], {})).warnings == ()
