"""Conditions whose parts do not go together: what is said of them before any message."""

from __future__ import annotations

import random
from itertools import product
from typing import Any

import pytest

from oracle_server.core.expression import MAX_STEPS, Absent, Failed, check_shape, parse_expression
from oracle_server.core.shapes import Shape
from tests.core.expression.test_shapes import SHAPE, found

VALUES = (0, 0.5, 1, 1.5, 2, 2.5, 3, 4, True, False, "p", "q", "r", "NaN", "Infinity", "-Infinity", None)


@pytest.mark.parametrize(
    ("text", "shape", "column", "says"),
    [
        ("msg.x < -1 && msg.x > 1", None, 1, "is never true, whatever `msg.x` is; write `||` where one of them"),
        ("msg.on || msg.x < -1 && 1 < msg.x", None, 11, "`msg.x < -1 && 1 < msg.x` is never true"),
        ("msg.mode != 'a' || msg.mode != 'b'", None, 1, "is never false, whatever `msg.mode` is; write `&&` where all"),
        ("!(msg.mode == 'a' && msg.mode == 'b')", None, 2, "is never true"),
        ("msg.x > 5 && !(msg.x > 3)", None, 1, "is never true"),
        ("msg.x in [1, 2] && msg.x == 3", None, 1, "is never true"),
        ("msg.x == 1 && msg.y > 2 && msg.x == 2", None, 1, "is never true, whatever `msg.x` is"),
        ("(msg.x < 1 || msg.x > 5) && msg.x > 2 && msg.x < 4", None, 1, "is never true"),
        ("msg.l.exists(e, e.v < 0 && e.v > 1)", None, 17, "is never true, whatever `e.v` is"),
        ("msg.l[0] > 2 && msg.l[ 0 ] < 1", None, 1, "is never true, whatever `msg.l[0]` is"),
        ("msg.name.contains('a b') && !msg.name.contains('a b')", None, 1, "is never true"),
        ("msg.count > 1 && msg.count < 2", SHAPE, 1, "is never true, whatever `msg.count` is"),
        ("msg.on == true || msg.on == false", SHAPE, 1, "is never false, whatever `msg.on` is"),
        ("msg.x > 3 || true", None, 1, "is never false, whatever the message is"),
        ("false && msg.x > 3", None, 1, "is never true, whatever the message is"),
        ("msg.x > 3 ? 'fast' : msg.x > 5 ? 'very fast' : 'slow'", None, 22, "`msg.x > 5` never decides: whatever"),
        ("msg.on ? 1 : msg.x == 1 ? 2 : msg.x in [0, 1] && msg.x > 0 ? 3 : 4", None, 31, "never decides"),
    ],
)  # fmt: skip
def test_a_condition_that_comes_to_the_same_is_warned_of(
    text: str, shape: Shape | None, column: int, says: str
) -> None:
    (problem,) = found(text, shape)
    assert (problem.within, problem.severity) == ((1, column), "warning")
    assert says in problem.message


@pytest.mark.parametrize(
    "text",
    [
        "msg.x < -1 || msg.x > 1",
        "msg.x > 1 && msg.x < 2",
        "msg.x != 'NaN' && msg.x < 0.5",
        "msg.x == 'Infinity' || msg.x < 3",
        "msg.count >= 1 && msg.count < 2",
        "msg.name.contains('a  b') && !msg.name.contains('a b')",
        "msg.name > 'b' && msg.name < 'a'",
        "msg.l.exists(e, e < 0) && msg.l.exists(e, e > 1)",
        "msg.l.exists(e, e < 0) && msg.l.all(e, e < 0)",
        "has(msg.x) && !has(msg.y)",
        "msg.x == 1 || msg.x == true || msg.x == '1'",
        "msg.x > 5 ? 'very fast' : msg.x > 3 ? 'fast' : msg.x <= 3 ? 'slow' : 'none'",
        "msg.on ? 1 : msg.x > 3 ? 2 : 3",
        "todo() && !todo()",
    ],
)
@pytest.mark.parametrize("shape", [SHAPE, None])
def test_one_that_can_come_to_either_is_not(text: str, shape: Shape | None) -> None:
    assert [p for p in found(text, shape) if "never" in p.message] == []


def test_what_is_said_is_so_for_every_value_and_said_wherever_one_part_decides() -> None:
    rng, said = random.Random(11), 0
    for _ in range(800):
        text = _condition(rng, ("msg.a",), 3)
        outcomes = _values(text, "a")
        problems = [p.message for p in check_shape(parse_expression(text), None)]
        whole = [m for m in problems if m.startswith(f"`{text}` is never")]
        if whole:
            said += 1
            assert outcomes - {None} == {"never false" in whole[0]}, (text, whole, outcomes)
        elif not problems:
            assert len(outcomes - {None}) != 1, (text, outcomes)
    assert said > 20


def test_what_is_said_is_so_of_conditions_about_several_parts() -> None:
    rng, said = random.Random(12), 0
    for _ in range(800):
        text = _condition(rng, ("msg.a", "msg.b"), 4)
        whole = [p.message for p in check_shape(parse_expression(text), None) if p.message.startswith(f"`{text}` is n")]
        if whole:
            said += 1
            outcomes = _values(text, "ab")
            assert outcomes - {None} <= {"never false" in whole[0]}, (text, whole, outcomes)
    assert said > 20


def test_a_test_that_never_decides_is_never_chosen_by() -> None:
    rng, said = random.Random(13), 0
    for _ in range(800):
        tests = [_condition(rng, ("msg.a", "msg.b"), 1) for _ in range(3)]
        text = "".join(f"({test}) ? {i} : " for i, test in enumerate(tests)) + "3"
        chosen = _values(text, "ab")
        for problem in check_shape(parse_expression(text), None):
            if "never decides" in problem.message:
                said += 1
                at = [i for i, test in enumerate(tests) if problem.message.startswith(f"`({test})`")]
                assert at, (text, problem)
                assert not set(at) <= chosen, (text, problem, chosen)
    assert said > 20


def test_a_condition_of_a_great_many_parts_is_looked_at_within_a_bound() -> None:
    text = " || ".join(f"msg.f{i % 90} == {i}" for i in range(180))
    assert found(text, None) == []


def _condition(rng: random.Random, operands: tuple[str, ...], depth: int) -> str:
    if depth == 0 or rng.random() < 0.25:
        operand, literal = rng.choice(operands), rng.choice(("1", "2", "3", "'p'", "'q'", "true", "'NaN'", "null"))
        if literal in ("1", "2", "3") and rng.random() < 0.6:
            mark = rng.choice(("<", "<=", ">", ">="))
            return rng.choice((f"{operand} {mark} {literal}", f"{literal} {mark} {operand}"))
        ways = (f"{operand} == {literal}", f"{operand} != {literal}", f"{operand} in [{literal}, 2]", operand)
        return rng.choice((*ways[:3], *ways))
    parts = [_condition(rng, operands, depth - 1) for _ in range(rng.choice((2, 2, 3)))]
    mark = rng.choice((" && ", " || "))
    parts = [f"!({part})" if rng.random() < 0.2 else f"({part})" if " " in part else part for part in parts]
    return mark.join(parts)


def _values(text: str, names: str) -> set[Any]:
    """What an expression comes to for all of the values of its fields; None where it comes to none."""
    expression, found = parse_expression(text), set[Any]()
    for values in product(VALUES, repeat=len(names)):
        try:
            message = dict(zip(names, values, strict=True))
            found.add(expression.code.run(message, expression.frame(MAX_STEPS)))
        except (Absent, Failed):
            found.add(None)
    return found
