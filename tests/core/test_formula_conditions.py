"""When a formula asks for anything: what is told to have never held has not, by a brute-force reading."""

from __future__ import annotations

import pytest
from hypothesis import given

from oracle_server.core.atoms import specialise
from oracle_server.core.formula.conditions import conditions, may_hold, needed, without
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Formula, walk
from tests.brute import TimedSignals, truths
from tests.strategies import formulas, traces


def holding(atom: Atom, steps: list[TimedSignals]) -> list[bool]:
    """At which steps an atom holds for some values."""
    tests = specialise([atom], {}, lambda _: True)
    return [any(test.match(signals) is not None for test in tests) for _, signals in steps]


@given(formulas("steps"), traces())
def test_what_never_held_never_did(part: Formula, steps: list[TimedSignals]) -> None:
    atoms = {node for node in walk(part) if isinstance(node, Atom)}
    held = {atom: holding(atom, steps) for atom in atoms}
    found = truths(part, steps, "steps")
    why = without(part, lambda atom: not any(held[atom]))
    assert set(why) <= set(needed(part))
    assert not why or not any(found)
    for i, holds in enumerate(found):
        assert not holds or may_hold(part, lambda atom, i=i: held[atom][i])  # type: ignore[misc]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{a} -> {b}", [["{a}"]]),
        ("not {a} or {b}", [["{a}"]]),
        ("forall[x]. {a: *x} -> {b} -> not once {c: *x}", [["{a: *x}", "{b}"]]),
        ("({a} -> {b}) and historically ({c} -> {d})", [["{a}"], ["{c}"]]),
        ("{a} -> ({b} -> {c}) and ({d} -> {c})", [["{a}", "{b}"], ["{a}", "{d}"]]),
        ("not ({a} and not {b} since {c} and pre {d})", [["not {b} since {c}", "pre {d}"]]),
        ("not (once {a} and pre {b})", []),
        ("not {a} or not {b}", []),
        ("not ({a} and {b})", []),
        ("({a} -> {b}) and {c}", []),
        ("exists[x]. {a: *x} -> {b}", []),
        ("once {a}", []),
    ],
)
def test_the_conditions_of_a_formula(text: str, expected: list[list[str]]) -> None:
    assert [[render(part) for part in found] for found in conditions(parse_formula(text))] == expected
