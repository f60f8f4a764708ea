"""Messages to signals: what is there, what is absent, what failed, and which expressions are not let in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.errors import ExpressionError
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
        ("msg.x * 2", 5.0),
        ("0 + msg.x", 2.5),
        ("msg.n / 2", 3),
        ("-msg.n / 2", -3),
        ("msg.n / 2.0", 3.5),
        ("1 - msg.x * 2 + msg.n", 3.0),
        ("abs(-msg.n) + abs(msg.x)", 9.5),
        ("min(msg.n, msg.x)", 2.5),
        ("max(msg.l) + max(1, 2.5)", 5.5),
        ("max(1, 0.5) / 2", 0.5),
        ("sqrt(msg.n + 2)", 3.0),
        ("msg.l.exists(v, msg.l.exists(w, v + w == 6))", True),
        ("msg.s == 'on' ? 'msg.z' : 'b'", "msg.z"),
        ("msg.l[1]", 2),
        ("msg.items[1].k", 2),
        ("msg.l.exists(v, v == 3)", True),
        ("size(msg.l.filter(v, v > 1)) + size(msg.l.filter(v, v > 2))", 3),
        ("has(msg.gone) ? msg.gone : 'none'", "none"),
        ("has(msg.none)", True),
        ("msg.none == null", True),
        ("msg.s.startsWith('o') || msg.s.contains(msg.key)", True),
        ("msg.s.upper()", "ON"),
        ("' Ready\\t'.trim().lower()", "ready"),
        ("'\\u212a\\u0130'.lower()", "ki\u0307"),
        ("size(msg.s.upper().lower())", 2),
        ("msg.b ? 1 : unknown()", 1),
        ("msg.b || todo()", True),
        ("'\\n' == \"\\x0a\" && '''a'b''' == \"a'b\"", True),
        ("msg.gone", ABSENT),
        ("msg.none", ABSENT),
        ("string(msg.none)", ABSENT),
        ("msg.head.stamp.nanosec", ABSENT),
        ("msg.none.deeper", ABSENT),
        ("msg.items[0].gone", ABSENT),
        ("msg.items.exists(i, i.gone == 1)", ABSENT),
        ("msg[msg.gone]", ABSENT),
        ("!msg.gone || msg.none > 3", ABSENT),
        ("has(msg.gone) && msg.s > 1", False),
        ("msg.gone == 1 || msg.n == 7", True),
        ("has(msg.gone.there)", ABSENT),
        ("msg.gone + 1", ABSENT),
        ("msg.none + 1", ABSENT),
        ("msg.head.gone.there == 1", ABSENT),
        ("null", ABSENT),
        ("msg.gone.lower()", ABSENT),
        ("msg.n.lower()", FAILED),
        ("msg.l.trim()", FAILED),
        ("todo()", FAILED),
        ("unknown()", FAILED),
        ("!todo()", FAILED),
        ("msg.gone == 1 || unknown()", FAILED),
        ("msg.l", FAILED),
        ("msg.head", FAILED),
        ("msg", FAILED),
        ("msg.nan", FAILED),
        ("msg.inf", FAILED),
        ("true ? msg.inf : 0.0", FAILED),
        ("1.0 / 0.0", FAILED),
        ("1 / 0", FAILED),
        ("msg.nan > 2.0", FAILED),
        ("msg.n.deeper", FAILED),
        ("msg.s.deeper", FAILED),
        ("msg.items.k", FAILED),
        ("msg.gone == 1 || msg.s > 1", FAILED),
        ("msg.s > 1 && msg.gone == 1", FAILED),
        ("has(msg.gone) ? msg.gone : 1 / 0", FAILED),
        ("msg.s + 1", FAILED),
        ("string(msg.b)", FAILED),
        ("string(msg.l)", FAILED),
        ("msg.l[3]", FAILED),
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


class Broken(dict[str, object]):
    """A message at which no expression can be evaluated."""

    def __getitem__(self, key: str) -> object:
        raise RuntimeError(key)

    def get(self, key: str, default: object = None) -> object:
        raise RuntimeError(key)


def test_no_fault_of_an_expressions_evaluation_ends_a_session() -> None:
    projection = Projection({"a": "msg.x", "b": "'always'"})
    assert projection(Broken(x=1)) == ({"b": "always"}, frozenset({"a"}))
    assert list(projection.reasons(Broken(x=1))) == ["a"]


@pytest.mark.parametrize("big", [[0] * 100_000, "7"], ids=["large", "of another type"])
def test_a_signal_that_fails_leaves_the_others(big: object) -> None:
    projection = Projection({"bad": "msg.big.all(v, v == 0)", "good": "msg.a + 1"})
    assert projection({"a": 1, "big": big}) == ({"good": 2}, frozenset(("bad",)))


@pytest.mark.parametrize(
    ("expressions", "read"),
    [
        (["msg.n"], {"n"}),
        (["msg.n > 1 || msg.gone"], {"n", "gone"}),
        (["msg.head.stamp.sec + msg.head.stamp.nanosec"], {"head.stamp.sec", "head.stamp.nanosec"}),
        (["msg.head.id", "msg.head"], {"head.id", "head"}),
        (["msg['s'] == msg.key"], {"s", "key"}),
        (["(msg.head).id", "has(msg.goal.x)"], {"head.id", "goal.x"}),
        (["msg.items[0].k", "msg.s.contains('msg.n')"], {"items", "s"}),
        (["msg.items.map(v, v.k)[0]", "msg.l.exists(v, v == msg.n)"], {"items", "l", "n"}),
        (["msg.head.msg.n"], {"head.msg.n"}),
        (["msg.head['a.b'].c"], {"head"}),
        (["7"], set()),
        (["[msg][0].n"], None),
        (["msg[msg.key]"], None),
        (["msg['a.b']"], None),
    ],
)
def test_the_fields_that_are_read_are_known(expressions: list[str], read: set[str] | None) -> None:
    assert Projection({str(i): e for i, e in enumerate(expressions)}).fields == read


@pytest.mark.parametrize(
    ("expression", "says"),
    [
        ("", "the expression is empty"),
        ("msg.l.all(msg, msg > 1)", "can't be called msg"),
        ("(" * 41 + "1" + ")" * 41, "nested more than 40 deep"),
        ("1" + " " * 4096, "at most 4096"),
    ],
)
def test_refused_before_any_message(expression: str, says: str) -> None:
    with pytest.raises(ExpressionError, match=says):
        Projection({"v": expression})


def test_without_declared_signals_the_scalar_fields_at_the_top_are_taken() -> None:
    projection = DefaultProjection(["n", "nan", "none", "head", "l", "gone", "b"])
    assert projection(MESSAGE) == ({"n": 7, "b": True}, frozenset(("nan",)))
    assert projection("text") == ({}, frozenset())
