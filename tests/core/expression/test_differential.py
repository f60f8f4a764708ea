"""What expressions mean is what CEL says: compared with a library for it, on random expressions and messages."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st

from oracle_server.core.expression import MAX_STEPS, Absent, Failed, parse_expression
from tests.core.expression.library import NOTHING, by_library, expression, messages, told_apart


def evaluated(text: str, message: dict[str, Any]) -> Any:
    expression = parse_expression(text)
    try:
        return expression.code.run(message, expression.frame(MAX_STEPS))
    except (Absent, Failed):
        return NOTHING


@settings(max_examples=500, deadline=None)
@given(random=st.randoms(use_true_random=True), message=messages())
def test_a_value_is_that_of_the_library(random: Random, message: dict[str, Any]) -> None:
    text = expression(random)
    note(text)
    value = evaluated(text, message)
    if value is None:  # a missing field that is all of the expression, or null
        value = message.get(text.removeprefix("msg."), NOTHING)
    assert told_apart(value) == told_apart(by_library(text, message))


@settings(max_examples=100, deadline=None)
@given(value=st.text(max_size=6) | st.integers(-(2**63), 2**64 - 1) | st.floats())
def test_a_value_of_a_field_is_that_of_the_library(value: object) -> None:
    for text in ("msg.a", "string(msg.a)", "msg.a == msg.a"):
        assert told_apart(evaluated(text, {"a": value})) == told_apart(by_library(text, {"a": value}))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2 * 2.5", 5.0),
        ("1.0 / 4", 0.25),
        ("msg.big + 1", 2**63 + 1),
        ("-(5u)", -5),
        ("size('é')", 1),
        ("-(true)", NOTHING),
        ("-(msg.least)", NOTHING),
        ("9007199254740993 == 9007199254740992.0", False),
        ("1 in {'a': 1}", NOTHING),
        ("has(msg['n'])", True),
        ("9223372036854775808", 2**63),
        ("max(1, 2) + min(3, 4) + abs(-5)", 10),
        ("sqrt(4)", 2.0),
    ],
)
def test_where_it_differs_it_is_meant_to(text: str, value: object) -> None:
    message = {"n": 7, "big": 2**63, "least": -(2**63)}
    assert told_apart(evaluated(text, message)) == told_apart(value)
    assert told_apart(by_library(text, message)) != told_apart(value)
