"""Between which numbers a part of an expression is, and what `check` says of comparisons by that."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.expression import MAX_STEPS, Absent, Failed, check_shape, parse_expression
from oracle_server.core.expression.check import known
from oracle_server.core.expression.spans import reads
from oracle_server.core.expression.values import NOT_FINITE, is_number
from oracle_server.core.shapes import Many, Record, Value

LEVEL, REAL = Value("whole", "uint8"), Value("real", "float64")
SHAPE = Record(
    "my_msgs/msg/All",
    {
        "a": LEVEL,
        "i": Value("whole", "int8"),
        "big": Value("whole", "uint64"),
        "x": REAL,
        "on": Value("bool", "bool"),
        "name": Value("text", "string"),
        "three": Many(LEVEL, 3),
        "many": Many(LEVEL),
    },
)
LEVELS = st.integers(0, 255)
MESSAGES = st.fixed_dictionaries(
    {
        "a": LEVELS,
        "i": st.integers(-128, 127),
        "big": st.integers(0, 2**64 - 1),
        "x": st.sampled_from(["NaN", "Infinity", "-Infinity", 3, -0.0]) | st.floats(-5, 5) | st.floats(allow_nan=False),
        "on": st.booleans(),
        "name": st.text(max_size=3),
        "three": st.lists(LEVELS, min_size=3, max_size=3),
        "many": st.lists(LEVELS, max_size=4),
    }
)
LEAVES = st.sampled_from(
    [
        *("msg.a", "msg.i", "msg.x", "msg.big", "0", "1", "-7", "2.5", "-0.5", "0.1", "300"),
        *("size(msg.three)", "size(msg.many)", "size(msg.name)", "max(msg.three)", "min([msg.a, 4])"),
        *("size(msg.three.filter(e, e > 9))", "size(msg.three.map(e, e + 1))", "msg.three[1]", "max(msg.many)"),
    ]
)
FORMS = st.sampled_from(
    [
        *("({0} + {1})", "({0} - {1})", "({0} * {1})", "({0} / {1})", "(int({0}) % int({1}))", "({0} * {0})"),
        *("-({0})", "abs({0})", "sqrt({0})", "int({0})", "uint({0})", "double({0})", "min({0}, {1})", "max({0}, {1})"),
        *("(msg.on ? {0} : {1})", "({0} - {1} * {1} + 2)", "({0} / {1} / 3)"),
    ]
)
NUMBERS = st.recursive(LEAVES, lambda inner: st.builds(str.format, FORMS, inner, inner), max_leaves=6)


def evaluated(text: str, message: dict[str, Any]) -> Any:
    expression = parse_expression(text)
    try:
        found = expression.code.run(message, expression.frame(MAX_STEPS))
    except (Absent, Failed):
        return None
    return NOT_FINITE.get(found, found) if isinstance(found, str) else found


@settings(max_examples=1000, deadline=None)
@given(text=NUMBERS, message=MESSAGES, typed=st.booleans())
def test_no_value_is_beyond_the_span_of_its_expression(text: str, message: dict[str, Any], typed: bool) -> None:
    expression = parse_expression(text)
    span = known(expression, expression.tree, SHAPE if typed else None).span
    value = evaluated(text, message)
    if span is not None and is_number(value) and not math.isnan(value):
        assert span.least <= value <= span.most
        assert not span.whole or isinstance(value, int)


@settings(max_examples=1000, deadline=None)
@given(one=NUMBERS, mark=st.sampled_from(["<", "<=", ">", ">=", "==", "!="]), other=NUMBERS, message=MESSAGES)
def test_what_is_told_of_a_comparison_holds(one: str, mark: str, other: str, message: dict[str, Any]) -> None:
    text = f"{one} {mark} {other}"
    told = [p.message for p in check_shape(parse_expression(text), SHAPE) if p.message.startswith(f"`{text}` is ")]
    value = evaluated(text, message)
    if told and value is not None:
        assert [("always" in message.removeprefix(f"`{text}` ")[:9]) for message in told] == [value] * len(told)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("size(msg.three) == 6", "is never true: `size(msg.three)` is always 3"),
        ("size(msg.three.filter(e, e > 4)) > 3", "is always a whole number from 0 to 3"),
        ("min(msg.x, 1) > 2", "`min(msg.x, 1)` is always a number of at most 1"),
        ("max(msg.three) > 255", "is always a whole number from 0 to 255"),
        ("int(msg.x) == 2.5", "`int(msg.x)` is always a whole number"),
        ("msg.a + msg.a > 510", "is always a whole number from 0 to 510"),
        ("msg.a - msg.i < -127", "is always a whole number from -127 to 383"),
        ("100 * msg.a / 255.0 > 100", "is always a number from 0.0 to 100.0"),
        ("sqrt(msg.x * msg.x + msg.y * msg.y) < 0", "is never negative"),
        ("(msg.on ? 1 : 0) > 1", "is always a whole number from 0 to 1"),
        ("abs(msg.x) < -abs(msg.x)", "`abs(msg.x)` is never negative and `-abs(msg.x)` is always"),
        ("msg.a > 0 || msg.a == 0", "is never false, whatever `msg.a` is"),
        ("size(msg.three) == 3", "is always true: `size(msg.three)` is always 3"),
    ],
)
def test_a_comparison_beyond_what_its_operands_can_be_is_warned_of(text: str, says: str) -> None:
    shape = Record(SHAPE.name, {**SHAPE.fields, "y": REAL})
    (problem,) = check_shape(parse_expression(text), shape)
    assert problem.severity == "warning"
    assert says in problem.message


@pytest.mark.parametrize(
    "text",
    [
        "size(msg.three) == 3 && msg.three[0] == 1",
        "size(msg.three) > 0 && msg.three[0] == 1",
        "size(msg.three) != 3 || msg.three[0] == 1",
        "size(msg.three) == 3 ? msg.three[0] : 0",
        "min(msg.x, 1) > 0.9",
        "min(msg.x, msg.x) > 2",
        "int(msg.x) == 2.0",
        "msg.a + msg.i > 381",
        "msg.x * msg.x <= 0",
        "abs(msg.x) <= 0",
        "msg.a - msg.i == 383",
        "msg.big - 1 > 18446744073709551613",
        "msg.a >= 0 && msg.a <= 255",
        "abs(msg.x) == 'Infinity'",
    ],
)
def test_one_that_can_come_to_either_is_not(text: str) -> None:
    assert check_shape(parse_expression(text), SHAPE) == []


def test_what_is_written_out_reads_nothing() -> None:
    assert not reads(parse_expression("3 * 2").tree)
    assert check_shape(parse_expression("msg.on || 3 > 2"), SHAPE) == []
