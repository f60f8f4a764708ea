"""What expressions mean is what CEL says: compared with a library for it, on random expressions and messages."""

from __future__ import annotations

import math
import re
from random import Random
from typing import Any

import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st

from oracle_server.core.expression import MAX_STEPS, Absent, Failed, parse_expression
from oracle_server.core.expression.values import NOT_FINITE, number
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
    assert alike(evaluated(text, message), by_library(text, message))


def alike(value: object, other: object) -> bool:
    """Whether a value is the library's, which tells a missing field from a null one where it is all that is given."""
    return told_apart(value) == told_apart(other) or (value is None and other == NOTHING)


real = st.sampled_from([math.inf, -math.inf, math.nan, 7.0]) | st.floats(-9, 9)


@settings(max_examples=500, deadline=None)
@given(random=st.randoms(use_true_random=True), message=messages(), x=real, y=real)
def test_the_text_of_a_number_that_is_not_finite_counts_as_that_number(
    random: Random, message: dict[str, Any], x: float, y: float
) -> None:
    text = expression(random, random.choice(["real", "bool"]))
    sent = {"x": _sent(x), "y": _sent(y)}
    if "string(" in text or ("NaN" in sent.values() and re.search("[!=]=", text)):
        return  # these see the text that has arrived
    note(text)
    assert alike(number(evaluated(text, {**message, **sent})), by_library(text, {**message, "x": x, "y": y}))


def _sent(value: float) -> float | str:
    """A number as adapters send it."""
    return next((text for text, meant in NOT_FINITE.items() if str(value) == str(meant)), value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("msg.ranges.exists(r, r < 0.5)", False),
        ("msg.ranges.all(r, r > 0.5)", True),
        ("min(msg.ranges) < 2.0", True),
        ("min(msg.ranges)", 1.5),
        ("max(msg.ranges) > 1e308", True),
        ("min(max(msg.ranges), msg.limit)", 10.0),
        ("msg.none > msg.limit && msg.none >= 'Infinity' && msg.less < msg.none", True),
        ("-msg.none == msg.less && abs(msg.less) == msg.none && msg.none * 2 == 'Infinity'", True),
        ("msg.none == 'Infinity' && msg.none != 'NaN' && msg.none + msg.none == msg.none", True),
        ("1 / msg.none + sqrt(msg.none) > 7", True),
        ("msg.none == msg.limit", False),
        ("msg.none * 2 in ['Infinity', 7]", True),
        ("msg.none in [msg.less, msg.none * 2]", True),
        ("msg.none - msg.none > 0", NOTHING),
        ("msg.odd < 0.5", NOTHING),
        ("msg.odd >= msg.odd", NOTHING),
        ("msg.odd < msg.none", NOTHING),
        ("!(msg.odd > 0.5)", NOTHING),
        ("msg.noisy.exists(r, r < 0.5)", NOTHING),
        ("msg.noisy.all(r, r > 0.5)", NOTHING),
        ("min(msg.noisy) < 0.5", NOTHING),
        ("msg.noisy.exists(r, r < 2.0)", True),
        ("msg.noisy.exists(r, r != 'NaN' && r < 0.5)", False),
        ("msg.noisy.all(r, r == 'NaN' || r > 0.5)", True),
        ("min(msg.noisy.filter(r, r != 'NaN')) < 2.0", True),
    ],
)
def test_a_scan_is_judged_by_its_infinities_and_not_by_its_nans(text: str, value: object) -> None:
    message = {
        "ranges": [1.5, "Infinity", 3, "Infinity"], "noisy": ["NaN", 1.5, "Infinity"], "limit": 10.0,
        "none": "Infinity", "less": "-Infinity", "odd": "NaN",
    }  # fmt: skip
    assert told_apart(evaluated(text, message)) == told_apart(value)


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
