"""What an expression costs is counted: attacks fail, or are cheap, and what is usual counts nothing when it runs."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.errors import ExpressionError
from oracle_server.core.expression import MAX_STEPS, Absent, Failed, parse_expression
from oracle_server.core.expression.stops import Exhausted
from oracle_server.core.signals import Projection

MESSAGE = {
    "a": 1,
    "s": "x" * 2_000,
    "t": "a" * 100_000,
    "l": list(range(4_000)),
    "f": [i / 7 for i in range(4_000)],
    "names": [f"robot_{i}_link_name" for i in range(4_000)],
    "nested": [[[0] * 10] * 10] * 40,
}


def spent(text: str, message: dict[str, Any], steps: int = MAX_STEPS) -> tuple[int, str]:
    """The steps that an expression takes beside those that are known, and how it ends."""
    expression = parse_expression(text)
    frame = expression.frame(steps)
    try:
        expression.code.run(message, frame)
    except (Absent, Failed) as stop:
        return steps - frame[0], type(stop).__name__
    return steps - frame[0], "value"


@pytest.mark.parametrize(
    "text",
    [
        "msg.names.exists(n, n.matches('(robot|arm)_[0-9]{1,5}_x'))",
        "+".join(["msg.l"] * 600) + " == []",
        "size(" + "+".join(["msg.l"] * 600) + ")",
        " && ".join(f"!msg.t.matches('(a|b){{1,20}}c{i}')" for i in range(40)),
        "msg.l.all(x, msg.l.all(y, x + y >= 0))",
        "[msg.t]" + ".map(x, x + x)" * 20 + ".size()",
        "msg.f.all(x, string(x) != 'a')",
        "msg.l.all(x, x in msg.l)",
        "msg.t.contains('" + "a" * 127 + "b')",
        "msg.l.all(x, 'a' + msg.t != msg.t)",
        " && ".join(["msg.l == msg.l"] * 40),
        "msg.nested.all(x, msg.nested == msg.nested)",
        "msg.l.map(x, [" + ",".join("0" * 900) + "]).size()",
        "msg.l.map(x, {" + ",".join(f"'{i}': 0" for i in range(300)) + "}).size()",
        "msg.l.exists(x, " + " || ".join(["msg.gone == 1"] * 9) + ")",
        "max(msg.l + msg.l + msg.l + msg.l + msg.l + msg.l + msg.l + msg.l + msg.l) > 1",
    ],
)
def test_an_attack_ends_when_its_steps_are_spent(text: str) -> None:
    assert spent(text, MESSAGE)[1] == "Exhausted"
    assert Projection({"v": text})(MESSAGE) == ({}, frozenset({"v"}))


def test_a_loop_is_charged_before_it_begins() -> None:
    """Its body would fail at the first element, and is not reached."""
    expression = parse_expression("msg.huge.all(x, 1 / 0 == 1)")
    with pytest.raises(Exhausted):
        expression.code.run({"huge": [0] * 10**6}, expression.frame(MAX_STEPS))


@pytest.mark.parametrize(
    "text",
    [
        "msg.a", "msg.a > 0 && msg.s == 'on'", "msg.a * 2 + 1.5 - abs(msg.a)", "string(msg.a)",
        "has(msg.a) || msg.s != ''",
        "msg.a > 3 ? 'x' : msg.a > 2 ? 'y' : 'z'", "msg.s.startsWith('map')", "size(msg.l) > 3", "msg.l[0] == 0",
        "msg.a in [1, 2, 3]", "min(msg.a, 2) + sqrt(msg.a)", "double(msg.a) / 2.0",
    ],
)  # fmt: skip
def test_what_is_usual_counts_nothing_when_it_runs(text: str) -> None:
    expression = parse_expression(text)
    assert not expression.code.varies
    assert spent(text, MESSAGE)[0] == 0
    assert 0 < expression.code.steps < 20


def test_a_scan_of_4000_ranges_is_within_the_bound() -> None:
    text = "msg.f.exists(r, r != 'NaN' && double(r) < 0.0)"
    assert spent(text, MESSAGE)[0] <= 40_000
    assert Projection({"v": text})(MESSAGE) == ({"v": False}, frozenset())


@pytest.mark.parametrize("name", ["lower", "trim", "upper"])
def test_what_is_made_of_a_text_costs_by_its_length(name: str) -> None:
    expression = parse_expression(f"size(msg.huge.{name}()) > 0")
    with pytest.raises(Exhausted):
        expression.code.run({"huge": " " * 10**6}, expression.frame(MAX_STEPS))
    assert expression.code.run({"huge": "a" * 1000}, expression.frame(MAX_STEPS))


def test_signals_that_depend_on_the_message_share_the_steps_equally() -> None:
    loop = "msg.l.all(x, x >= 0)"
    alone = Projection({"v": loop})
    assert alone(MESSAGE)[0] == {"v": True}
    many = Projection({**{f"v{i}": loop for i in range(10)}, "a": "msg.a > 0"})
    values, failed = many(MESSAGE)
    assert values == {"a": True}
    assert len(failed) == 10
    assert set(many.reasons(MESSAGE).values()) == {"costs more than 10000 steps"}


def test_more_steps_at_every_message_than_are_allowed_are_refused() -> None:
    text = " + ".join(["1"] * 900)
    assert Projection({"v": text})({})[0] == {"v": 900}
    with pytest.raises(ExpressionError, match="at every message"):
        Projection({f"v{i}": text for i in range(10)})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("msg.s.matches(msg.t)", "written out"),
        ("msg.s.matches('" + "a" * 257 + "')", "at most 256"),
        ("msg.s.matches('(a{1000}b{1000}c{1000})')", "too large"),
        ("msg" + ".a" * 65, "at most 64 names"),
        ("!" * 41 + "true", "nested more than 40 deep"),
        ("msg.l" + "[0]" * 41, "nested more than 40 deep"),
        ("size(" * 41 + "msg.l" + ")" * 41, "nested more than 40 deep"),
        ("1 < 2 < 3", "in a row"),
    ],
)
def test_what_has_no_bound_is_refused(text: str, says: str) -> None:
    with pytest.raises(ExpressionError, match=says):
        parse_expression(text)


def test_values_that_are_nested_deep_are_not_followed_for_ever() -> None:
    deep: Any = 1
    for _ in range(5_000):
        deep = [deep]
    assert Projection({"v": "msg.d == msg.d", "w": "size(msg.d)"})({"d": deep}) == ({"w": 1}, frozenset({"v"}))
