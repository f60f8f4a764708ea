"""Formulas that wait for what comes: what is read, what is refused, with its place."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.ahead import needs, obligation
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Always, Bound, Eventually, Forall, Implies, Next, Until, walk

READ = [
    "{a} -> eventually[:60] {b}",
    "{a} -> eventually {b}",
    "forall[x]. {a: *x} -> eventually[2:5] ({b: *x} and always[:3] not {c: *x})",
    "forall[x]. forall[y]. {a: *x, b: *y} -> {c: *x} until[:5] {d: *y}",
    "{a} -> next next {b}",
    "once {a} and {b} -> (next {c} or eventually[:2] {d}) and {e}",
    "{a} -> {b} since {c} until[:4] {e}",
    "eventually[:3] {a}",
    "{a} -> always[:9] ({b} -> eventually[:2] {c})",
    "{a} -> eventually[:3] (exists[x]. {b: *x} and once {c: *x})",
]


@pytest.mark.parametrize("text", READ)
def test_what_is_printed_is_read_as_the_same(text: str) -> None:
    formula = parse_formula(text)
    assert render(formula) == text
    assert parse_formula(render(formula)) == formula


def test_the_tree() -> None:
    found = parse_formula(
        "forall[x]. {a: *x} -> ({b: *x} until[:2s] {c}) and always next eventually[1s:] {d}", "seconds"
    )
    assert isinstance(found, Forall)
    assert isinstance(found.body, Implies)
    first, *rest = [node for node in walk(found.body.right) if isinstance(node, Until | Always | Next | Eventually)]
    assert isinstance(first, Until)
    assert first.bound == Bound(0, 2 * 10**9)
    assert [type(node) for node in rest] == [Always, Next, Eventually]
    assert first.at == (1, 32)


def test_the_parts_of_an_obligation() -> None:
    found = obligation(parse_formula("forall[x, y]. {a: *x, b: *y} -> eventually[:2] {c: *y}"))
    assert found is not None
    assert found.variables == ("x", "y")
    assert render(found.goal) == "eventually[:2] {c: *y}"
    assert obligation(parse_formula("{a} -> once {b}")) is None


@pytest.mark.parametrize(
    ("text", "place", "says"),
    [
        ("once (\n  eventually[:5] {a})", (2, 3), "write it the other way round"),
        ("{a} -> historically[:3] next {b}", (1, 25), "write it the other way round, `historically` within `next`"),
        ("{a} -> {b} since always[:2] {c}", (1, 18), "write it the other way round"),
        ("{a} -> not eventually[:5] {b}", (1, 12), "write `always not …`"),
        ("{a} -> not always[:5] {b}", (1, 12), "write `eventually not …`"),
        ("eventually[:5] {a} -> {b}", (1, 1), "must be known at once"),
        ("eventually[:5] {a} -> next {b}", (1, 1), "`eventually` stands before `->`"),
        ("{a} -> (next {b} -> next {c})", (1, 9), "`next` stands before `->`"),
        ("eventually {a}", (1, 1), "without an upper bound each step would wait for ever"),
        ("always {a}", (1, 1), "so leave `always` out"),
        ("always[:5] eventually {a}", (1, 12), "without an upper bound"),
        ("{a} until {b}", (1, 5), "without an upper bound"),
        ("forall[x]. eventually[:5] {a: *x}", (1, 12), "for which values of 'x' is `eventually` asked for?"),
        ("forall[x]. not {a: *x} -> eventually[:5] {b: *x}", (1, 27), "can hold without it"),
        ("forall[x]. {c} or {a: *x} -> eventually[:5] {b: *x}", (1, 30), "can hold without it"),
        ("{a} -> forall[x]. eventually[:5] {b: *x}", (1, 8), "`forall[x].` stands in front of all of it"),
        ("exists[x]. {a: *x} -> eventually[:5] {b: *x}", (1, 1), "`forall[x].` stands in front of all of it"),
        ("{a} -> eventually[5:2] {b}", (1, 19), "the bound [5:2] is empty"),
    ],
)
def test_what_is_refused_and_where(text: str, place: tuple[int, int], says: str) -> None:
    with pytest.raises(FormulaError) as refused:
        parse_formula(text)
    assert says in str(refused.value)
    assert (refused.value.line, refused.value.column) == place


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("{a: *x} and not {b: *y}", "x"),
        ("{a: *x} or {b: *x, c: *y}", "x"),
        ("once {a: *x}", "x"),
        ("not (not {a: *x} or {c})", "x"),
        ("historically[:3] {a: *x}", "x"),
        ("historically[1:3] {a: *x}", ""),
        ("{c} since {a: *x}", "x"),
        ("{a: *x} since {c}", ""),
        ("not ({a: *x} -> {c})", "x"),
        ("exists[z]. {a: *z, b: *x}", "x"),
    ],
)
def test_a_value_that_no_event_has_had_can_not_trigger(text: str, names: str) -> None:
    variables = [name for name in "xy" if f"*{name}" in text]
    formula = parse_formula(f"forall[{', '.join(variables)}]. {text}")
    for _ in variables:
        assert isinstance(formula, Forall)
        formula = formula.body
    assert needs(formula) == frozenset(names)
