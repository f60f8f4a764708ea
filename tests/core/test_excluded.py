"""Implications whose right side fails wherever their left side holds."""

from __future__ import annotations

import pytest

from oracle_server.specfiles.load import parse_spec

STREAMS = """
id: x
streams:
  - {topic: /goal, signals: {goal: msg.id, mode: "msg.on ? 'AUTO' : 'IDLE'"}, hold: [mode]}
  - {topic: /done, signals: {done: msg.id, speed: abs(msg.v)}}
properties:
"""


def told(formula: str, time: str = "steps") -> list[str]:
    row = {"id": "p", "formula": formula, "time": time}
    found = parse_spec(f"{STREAMS}  - {row}\n", "x.yaml").warnings
    return [str(each) for each in found]


@pytest.mark.parametrize(
    ("formula", "mend"),
    [
        ("forall[g]. {done: *g} -> not {done: *g} since {goal: *g}", "`pre (not {done: *g} since {goal: *g})`"),
        ("forall[g]. {done: *g} -> not once {done: *g}", "`not pre once {done: *g}`"),
        ("forall[g]. {done: *g} -> historically not {done: *g}", "`not pre once {done: *g}`"),
        ("{done: 1} -> not once[:9] {done: 1}", "`not once[1:9] {done: 1}`"),
        ("{done: 1} -> historically[:9] not {done: 1}", "`not once[1:9] {done: 1}`"),
        ("forall[g]. {goal: *g} -> always not {goal: *g}", "`next always not {goal: *g}`"),
        ("forall[g]. {goal: *g} -> not {goal: *g} until {done: *g}", "`next (not {goal: *g} until {done: *g})`"),
        ("{speed > 3} -> {speed < 2}", ""),
        ("{mode: AUTO} -> {mode: IDLE}", ""),
    ],
)
def test_what_only_says_that_its_left_side_never_holds_is_told(formula: str, mend: str) -> None:
    (found,) = told(formula)
    assert "so that this says no more than `not " in found
    assert mend in found
    assert ("; write" in found) is bool(mend)


def test_the_mend_is_sound() -> None:
    assert told("forall[g]. {done: *g} -> pre (not {done: *g} since {goal: *g})") == []
    assert told("forall[g]. {goal: *g} -> next always not {goal: *g}") == []
    assert told("{done: 1} -> not once[1:9] {done: 1}") == []


@pytest.mark.parametrize(
    "formula",
    [
        "forall[g]. {done: *g} -> once {goal: *g}",
        "forall[g]. {done: *g} -> not pre once {done: *g}",
        "{done > 3} -> not {done: 5} since {goal: 5}",
        "forall[g]. {goal: *g} -> not {goal: 7} until {done: *g}",
        "forall[g]. {done: *g} -> not {done: 1} since {goal: *g}",
        "{mode: AUTO} -> {speed < 2}",
        "{goal: 1} -> eventually[:60] {done: 1}",
        "not {done: 1}",
    ],
)
def test_what_may_hold_is_not(formula: str) -> None:
    assert not [each for each in told(formula) if "says no more than" in each]
