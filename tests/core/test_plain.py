"""Plain expressions: whatever they answer without the CEL library, the library answers too."""

from __future__ import annotations

from typing import Any

import cel
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.plain import Declined, plain

LITERALS = ["0", "7", "-3", "40.0", "2.5e1", "1e2", "-0.0", "'on'", '"off"', "''", "true", "false"]
PATHS = ["msg.a", "msg.b", "msg.c.d"]
MARKS = ["<", "<=", ">", ">=", "==", "!="]

scalars = (
    st.sampled_from([0, 7, -3, 40, 40.0, 2.5, -0.0, "on", "off", "7", "", "NaN", True, False, None])
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=3)
)
values = scalars | st.lists(scalars, max_size=2) | st.dictionaries(st.sampled_from("de"), scalars, max_size=2)
messages = st.dictionaries(st.sampled_from("abc"), values)


def expressions() -> st.SearchStrategy[str]:
    operands = st.sampled_from(PATHS + LITERALS) | st.sampled_from(PATHS).map(lambda path: f"string({path})")
    comparisons = st.tuples(operands, st.sampled_from(MARKS), operands).map(" ".join)
    return st.recursive(
        operands | comparisons,
        lambda inner: st.one_of(
            st.tuples(inner, st.sampled_from(["&&", "||"]), inner).map(" ".join),
            inner.map(lambda text: f"!({text})"),
            inner.map(lambda text: f"({text})"),
            st.tuples(inner, inner, inner).map(lambda t: f"({t[0]}) ? ({t[1]}) : {t[2]}"),
            st.tuples(inner, st.sampled_from(MARKS), inner).map(lambda t: f"({t[0]}){t[1]}({t[2]})"),
        ),
        max_leaves=8,
    )


def by_library(text: str, message: dict[str, Any]) -> Any:
    context = cel.Context()
    context.add_variable("msg", message)
    return cel.compile(text).execute(context)


@settings(max_examples=2000, deadline=None)
@given(text=expressions(), message=messages)
def test_what_is_answered_is_what_the_library_answers(text: str, message: dict[str, Any]) -> None:
    evaluate = plain(text)
    if evaluate is None:
        return
    try:
        value = evaluate(message)
    except Declined:
        return
    if not isinstance(value, str | bool | int | float):  # a missing field is absent and any other no signal, either way
        return
    expected = by_library(text, message)
    assert (type(value), repr(value)) == (type(expected), repr(expected))


@pytest.mark.parametrize(
    ("text", "message", "value"),
    [
        ("msg.p > 40.0 ? '1' : msg.p > 30.0 ? '2' : '3'", {"p": 35}, "2"),
        ("msg.s >= 0 && msg.s <= 3 ? string(msg.s) : 'INVALID'", {"s": 3}, "3"),
        ("msg.a.b == 'x' || !msg.c", {"a": {"b": "y"}, "c": False}, True),
        ("false && msg.gone == 1", {}, False),
        ("string(msg.id)", {"id": "seven"}, "seven"),
        ("msg.deep.er", {"deep": {"er": 2.5}}, 2.5),
    ],
)
def test_the_common_kinds_are_answered(text: str, message: dict[str, Any], value: object) -> None:
    evaluate = plain(text)
    assert evaluate is not None
    assert evaluate(message) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("msg.a > 1", {}),
        ("msg.a > 1", {"a": "2"}),
        ("msg.a > 1", {"a": True}),
        ("msg.a > 1", {"a": float("nan")}),
        ("msg.a == 1", {"a": 2**53 + 1}),
        ("msg.a < true", {"a": False}),
        ("msg.a ? 1 : 2", {"a": 1}),
        ("string(msg.a)", {"a": 2.5}),
        ("string(msg.a)", {"a": True}),
        ("msg.a < 'é'", {"a": "z"}),
    ],
)
def test_what_is_in_doubt_is_left_to_the_library(text: str, message: dict[str, Any]) -> None:
    evaluate = plain(text)
    assert evaluate is not None
    with pytest.raises(Declined):
        evaluate(message)


@pytest.mark.parametrize(
    "text",
    [
        "msg",
        "msg.a + 1",
        "msg.a -1",
        "msg.a < 1 < 2",
        "msg.a[0]",
        "msg.size()",
        "msg.f(1)",
        "has(msg.a)",
        "'a' 'b'",
        "'''a'''",
        r"'\n'",
        "r'a'",
        "1u",
        "0x1F",
        "9007199254740993",
        "1e400",
        "msg.a // what",
        "msg.a ? 1",
        "(msg.a",
        "string msg.a",
        "null",
        "msgs.a",
        "trues",
        "[msg.a]",
        "",
    ],
)
def test_what_takes_more_is_left_to_the_library(text: str) -> None:
    assert plain(text) is None


def test_depth_has_an_end() -> None:
    assert plain("!" * 4000 + "msg.a") is None
    assert plain(" && ".join(["msg.a"] * 600)) is None
