"""Messages to signals: what is there, what is absent, what failed, and which expressions are not let in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from oracle_server.core.errors import ExpressionError
from oracle_server.core.expressions import MAX_ELEMENTS, MAX_NESTING, MAX_TEXT, parse_expression, prune
from oracle_server.core.signals import DefaultProjection, Projection

ABSENT, FAILED = "is absent", "has failed"

often = settings(max_examples=300, deadline=None)
integers = st.integers(-(2**63), 2**64 - 1)
texts = st.text().filter(lambda text: text not in ("NaN", "Infinity", "-Infinity"))


def project(expression: str, message: object) -> tuple[str, Any]:
    """What becomes of one signal, with its type: 1, 1.0 and True are different here."""
    values, failed = Projection({"v": expression})(message)
    assert set(values) | failed <= {"v"}
    assert not (values and failed)
    if values:
        return type(values["v"]).__name__, values["v"]
    return (FAILED if failed else ABSENT), None


def nested(depth: int, inside: object = 1) -> object:
    return {"d": nested(depth - 1, inside)} if depth else inside


MESSAGE: Mapping[str, Any] = dict(
    {"n": 7, "x": 2.5, "s": "on", "b": True, "none": None, "nan": "NaN", "inf": math.inf, "l": [1, 2, 3], "key": "n"},
    head={"stamp": {"sec": 5}, "id": "map"},
    items=[{"k": 1}, {"k": 2}],
)


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("msg.n", 7),
        ("msg.x", 2.5),
        ("msg.b", True),
        ("msg . head. id", "map"),
        ("msg['n']", 7),
        (r"msg['\x6e']", 7),
        ('msg.head["stamp"].sec', 5),
        ("msg.head // where\n .id", "map"),
        ("msg[msg.key]", 7),
        ("{'all': msg}.all.n", 7),
        ("string(msg.n)", "7"),
        ("string(msg.x)", "2.5"),
        ("string( msg.s )", "on"),
        ("msg.n > 2.5 && msg.x < 3", True),
        ("msg.n == 7.0", True),
        ("msg.n == '7'", False),
        ("msg.n + 1", 8),
        ("msg.s == 'on' ? 'msg.z' : 'b'", "msg.z"),
        ("msg.l[1]", 2),
        ("msg.items[1].k", 2),
        ("msg.l.exists(v, v == 3)", True),
        ("size(msg.l.filter(v, v > 1)) + size(msg.l.filter(v, v > 2))", 3),
        ("has(msg.gone) ? msg.gone : 'none'", "none"),
        ("has(msg.none)", True),
        ("msg.none == null", True),
        ("msg.s.startsWith('o') || msg.s.contains(msg.key)", True),
        ("'\\n' == \"\\x0a\" && '''a'b''' == \"a'b\"", True),
        ("msg.gone", ABSENT),
        ("msg.none", ABSENT),
        ("string(msg.none)", ABSENT),
        ("msg.head.stamp.nanosec", ABSENT),
        ("msg.n.deeper", ABSENT),
        ("msg.gone + 1", ABSENT),
        ("msg.none + 1", ABSENT),
        ("msg.head.gone.there == 1", ABSENT),
        ("null", ABSENT),
        ("msg.l", FAILED),
        ("msg.head", FAILED),
        ("msg", FAILED),
        ("msg.nan", FAILED),
        ("msg.inf", FAILED),
        ("true ? msg.inf : 0.0", FAILED),
        ("1.0 / 0.0", FAILED),
        ("1 / 0", FAILED),
        ("msg.x * 2", FAILED),
        ("msg.nan > 2.0", FAILED),
        ("msg.s + 1", FAILED),
        ("string(msg.b)", FAILED),
        ("string(msg.l)", FAILED),
        ("msg.l[3]", FAILED),
        ("b'raw'", FAILED),
        ("timestamp('2020-01-01T00:00:00Z')", FAILED),
        ("9223372036854775807 + msg.n", FAILED),
    ],
)
def test_a_signal_is_there_or_absent_or_failed(expression: str, expected: object) -> None:
    found = project(expression, MESSAGE)
    assert found == ((expected, None) if expected in (ABSENT, FAILED) else (type(expected).__name__, expected))


@pytest.mark.parametrize("message", [None, "text", 3, [], [1]])
def test_a_message_without_fields_has_no_signals(message: object) -> None:
    assert project("msg.a", message) == (ABSENT, None)
    assert project("string(msg.a)", message) == (ABSENT, None)


@often
@given(value=integers | st.floats() | texts | st.booleans())
@example(-0.0)
@example(2**63)
@example(1e300)
@example("")
def test_the_short_way_and_cel_agree(value: object) -> None:
    """A path, and `string()` of one, are read without CEL; in parentheses they are not."""
    for short, long in (("msg.a", "(msg.a)"), ("string(msg.a)", "string((msg.a))")):
        assert project(short, {"a": value}) == project(long, {"a": value})


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity"])
def test_the_short_way_and_cel_agree_on_what_is_no_number(value: str) -> None:
    assert project("string(msg.a)", {"a": value}) == project("string((msg.a))", {"a": value})


@often
@given(value=integers)
def test_64_bits_are_exact(value: int) -> None:
    literal = f"{value}u" if value >= 2**63 else str(value)
    assert project("msg.a", {"a": value}) == ("int", value)
    assert project("true ? msg.a : msg.b", {"a": value, "b": 0}) == ("int", value)
    assert project("string(msg.a)", {"a": value}) == ("str", str(value))
    assert project(f"msg.a == {literal}", {"a": value}) == ("bool", True)
    other = value - 1 if value > 0 else value + 1
    assert project("msg.a == msg.b", {"a": value, "b": other}) == ("bool", False)


def test_nothing_is_left_of_the_message_before() -> None:
    projection = Projection({"sum": "msg.a + 1", "path": "msg.a", "text": "string(msg.a)"})
    assert projection({"a": 1})[0] == {"sum": 2, "path": 1, "text": "1"}
    assert projection({}) == ({}, frozenset())
    assert projection({"a": object()}) == ({}, frozenset(("sum", "path", "text")))
    assert projection("nothing")[0] == {}
    assert projection({"a": 5})[0] == {"sum": 6, "path": 5, "text": "5"}


@pytest.mark.parametrize(
    "big", [[0] * (MAX_ELEMENTS + 1), nested(MAX_NESTING + 9), "7"], ids=["large", "deep", "of another type"]
)
def test_a_signal_that_fails_leaves_the_others(big: object) -> None:
    projection = Projection({"bad": "msg.big.all(v, v == 0)", "good": "msg.a + 1"})
    assert projection({"a": 1, "big": big}) == ({"good": 2}, frozenset(("bad",)))


def test_size_and_depth_of_what_is_read_are_bounded() -> None:
    large = {"l": [1] * MAX_ELEMENTS, "n": [0]}
    assert project("size(msg.l) + size(msg.n)", large) == ("int", MAX_ELEMENTS + 1)
    assert project("msg.l.all(v, v == 1) && msg.n.all(v, v == 0)", large) == (FAILED, None)
    assert project("msg.n.all(v, v == 0)", large) == ("bool", True)  # what is not read does not count
    for depth, expected in ((MAX_NESTING // 2, "int"), (MAX_NESTING + 1, FAILED)):
        assert project("size(msg.d)", {"d": nested(depth)})[0] == expected
        assert project("msg.a + 1", {"a": 1, "d": nested(depth)}) == ("int", 2)


@pytest.mark.parametrize(
    ("expressions", "kept"),
    [
        (["msg.n"], {"n": 7}),
        (["msg.n > 1 || msg.gone"], {"n": 7}),
        (["msg.head.stamp.sec + msg.head.stamp.nanosec"], {"head": {"stamp": {"sec": 5}}}),
        (["msg.head.id", "msg.head"], {"head": MESSAGE["head"]}),
        (["msg.head", "msg.head.stamp.sec"], {"head": MESSAGE["head"]}),
        (["msg.head.stamp.sec", "msg.head.id", "msg.head.stamp"], {"head": MESSAGE["head"]}),
        (["msg['s'] == msg.key"], {"s": "on", "key": "n"}),
        (["msg.items[0].k", "msg.s.contains('msg.n')"], {"items": MESSAGE["items"], "s": "on"}),
        (["msg.items.map(v, v.k)[0]"], {"items": MESSAGE["items"]}),
        (["msg.n.deeper"], {"n": 7}),
        (["msg.head.msg.n"], {"head": {}}),
        ([r"msg.s == r'\' || msg.n > 1 || msg.s == r'\'"], {"s": "on", "n": 7}),
        (["[msg][0].n"], MESSAGE),
        (["msg[msg.key]"], MESSAGE),
    ],
)
def test_only_what_is_read_is_handed_on(expressions: list[str], kept: Mapping[str, Any]) -> None:
    message = deepcopy(dict(MESSAGE))
    assert prune(message, tuple(parse_expression(e) for e in expressions)) == kept
    assert message == MESSAGE


@pytest.mark.parametrize(
    ("expression", "says"),
    [
        ("", "not a CEL expression"),
        ("msg.", "not a CEL expression"),
        ("msg.a msg.b", "not a CEL expression"),
        ("'open", "not a CEL expression"),
        ("mgs.a", "unknown name 'mgs'"),
        ("msg.a + a", "unknown name 'a'"),
        ("foo(msg.a)", "unknown function 'foo'"),
        ("msg.a.lowerAscii()", "unknown function 'lowerAscii'"),
        ("msg.l.all(x, msg.l.all(y, x == y))", "can't be nested"),
        ("msg.l . map (x, [1]. filter(y, true))", "can't be nested"),
        ("msg.l.exists(x, (msg.l).exists_one(x, true))", "can't be nested"),
        (r"msg.l.all(x, true) && r'\' != '' && msg.l.all(x, msg.l.all(x, true)) && r'\' != ''", "can't be nested"),
        ("msg.l.all(msg, msg > 1)", "can't be called msg"),
        ("(" * 65 + "1" + ")" * 65, "nested more than 64 deep"),
        ("1" + " " * MAX_TEXT, "at most 4096"),
    ],
)
def test_refused_before_any_message(expression: str, says: str) -> None:
    with pytest.raises(ExpressionError, match=says):
        Projection({"v": expression})


@pytest.mark.parametrize(
    ("expression", "value"),
    [("max(msg.n, 2)", 7), ("min(msg.n, 2)", 2), ("bool('true')", True), ("double('2.5')", 2.5), ("int('7')", 7)],
)
def test_a_function_that_the_library_lacks_is_refused_at_once(expression: str, value: object) -> None:
    """What is let in works; an expression that fails at every message would make its properties unknown for ever."""
    try:
        parse_expression(expression)
    except ExpressionError as error:
        refusal = str(error)
    else:
        assert project(expression, MESSAGE)[1] == value
        return
    assert "unknown function" in refusal


def test_without_declared_signals_the_scalar_fields_at_the_top_are_taken() -> None:
    projection = DefaultProjection(["n", "nan", "none", "head", "l", "gone", "b"])
    assert projection(MESSAGE) == ({"n": 7, "b": True}, frozenset(("nan",)))
    assert projection("text") == ({}, frozenset())
