"""`true`, `false`, `first` and `lasting` in sessions and in `check`: at ticks, under guards, no false alarms."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.verdicts import Judged
from oracle_server.engines.native import NativeEngine
from oracle_server.specfiles.load import parse_spec
from tests.core.sessions import A, B, Feed, open_session, outcomes, prop

SPEC = """id: s
streams:
  - {topic: /a, signals: {x: msg.x}, hold: [x]}
  - {topic: /b, signals: {y: msg.y}}
properties:
  - id: p
    time: seconds
    formula: |
      %s
"""


def warned(formula: str) -> list[str]:
    return [finding.message for finding in parse_spec(SPEC % formula, "s.yaml").warnings]


def explanation(judged: list[Judged]) -> str:
    found = [v.explanation for j in judged for v in j.verdicts if v.explanation]
    return str(found[0].text)


def test_first_is_the_first_step_and_no_tick() -> None:
    session = open_session(
        [prop("p", "once[:1us] first", time="seconds"), prop("q", "not first", time="seconds")],
        attach={"m": [A, B]},
        maker=lambda p: NativeEngine(p.formula, p.time),
        begun=0,
        by="arrival",
    )
    feed = Feed(session)
    before = session.advance(2_000)
    assert outcomes(before, "p") == ["currently_false"], "no step has come, and a tick is none"
    judged = [*feed(A, 3_000), *feed(B, 3_500)]
    assert outcomes(judged, "p") == ["currently_true", "currently_true"]
    assert outcomes(judged, "q") == ["currently_false", "currently_true"]


@pytest.mark.parametrize(
    "formula",
    [
        "first -> {topic: /a}",
        "pre true -> {x: *}",
        "{topic: /b} -> once[2s:] true",
        "{topic: /b} -> false",
        "true since[2s:] {topic: /b}",
        "{topic: /b} -> not lasting[2s] {x > 3}",
        "historically (first -> {topic: /a})",
    ],
)
def test_what_says_something_is_not_warned_of(formula: str) -> None:
    assert warned(formula) == []


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("true", "it holds at every event"),
        ("{x: 3} and false", "it fails at every event"),
        ("{topic: /b} -> {x: 3} or true", "it holds at every event"),
        ("{topic: /b} -> not lasting[2s] {y > 3}", "ends the `lasting`"),
    ],
)
def test_what_says_nothing_is(formula: str, says: str) -> None:
    (message,) = warned(formula)
    assert says in message


def test_a_guard_with_a_word_is_known_to_be_mendable() -> None:
    text = SPEC.replace("/a, ", "/a, action: filter, ").replace("id: p", "id: p\n    guards: [/a]")
    assert parse_spec(text % "first -> {topic: /b}", "s.yaml").warnings == ()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("lasting {a}", "1:9: `lasting` is followed by how long, in square brackets: write `lasting[5] {…}`"),
        ("lasting[2:5] {a}", "1:10: `lasting` is followed by how long, in square brackets: write `lasting[2] {…}`"),
        ("lasting (5) {a}", "1:9: `lasting` is followed by how long"),
        ("lasting[1.5] {a}", "1:9: the bound '1.5' is not a number of steps"),
        ("first[2]", "1:6: `first` has no bound"),
        ("first {a}", "1:7: `{` is not expected here: between two parts stands `and`"),
        ("{a} -> True", "1:8: there is no operator `True`: write `true`"),
        ("truee", "1:1: there is no operator `truee`; did you mean `true`?"),
        ("lasting[1] " * 20 + "{a}", "1:1: the formula has 2,097,151 parts once all is written out"),
    ],
)
def test_a_mistake_is_told_with_its_mend(text: str, says: str) -> None:
    with pytest.raises(FormulaError) as refusal:
        parse_formula(text)
    assert says in str(refusal.value)


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("first -> {topic: /b}", 'first: holds at step 1 (0.000 s); {topic: "/b"}: topic = "/a", wanted'),
        ("{topic: /a} -> false", "false: does not hold at step 1"),
        ("once[1:] first", "once[1:] first: none before there were steps"),
        ("not lasting[1] {v: 3}", "lasting[1] {v: 3}: {v: 3} held at step 1"),
    ],
)
def test_explanations_have_the_words(formula: str, says: str) -> None:
    session = open_session(
        [prop("p", formula)], attach={"m": [A]}, maker=lambda p: NativeEngine(p.formula, p.time), by="arrival"
    )
    feed = Feed(session)
    judged = [*feed(A, 1, {"v": 3}), *feed(A, 2, {"v": 3})]
    assert says in explanation(judged)
