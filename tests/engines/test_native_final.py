"""When the native engine says that nothing can change a verdict any more."""

from __future__ import annotations

import os
import random
from dataclasses import fields
from typing import Any

import pytest

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.relations import check_relations
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Bound, Formula
from oracle_server.core.verdicts import FINAL, Outcome
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals, truths
from tests.engines.test_against_brute import SEED, outcomes
from tests.strategies import START

CASES = int(os.environ.get("CASES", "500"))


def settling(rng: random.Random, formula: Formula) -> Formula:
    """The formula with many of its atoms in parts that settle."""
    if isinstance(formula, tree.Atom):
        kind = rng.choice((None, tree.Once, tree.Historically))
        return formula if kind is None else kind(formula, Bound(rng.choice((0, 0, 2)), None))
    if isinstance(formula, tree.Relation):
        return formula
    parts: dict[str, Any] = {field.name: getattr(formula, field.name) for field in fields(formula)}
    for name in ("operand", "left", "right", "body"):
        if name in parts:
            parts[name] = settling(rng, parts[name])
    return type(formula)(**parts)


def accepted(formula: Formula) -> bool:
    try:
        check_relations(formula)
    except FormulaError:
        return False
    return True


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_no_continuation_changes_a_final_outcome(time: Time) -> None:
    finals = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"final {time} {number}")
        formula = generate.either(rng, time, rng.randint(2, 4))
        if number % 2 and accepted(changed := settling(rng, formula)):
            formula = changed
        steps = generate.trace(rng, rng.randint(1, 8))
        found = outcomes(NativeEngine(formula, time), formula, steps)
        final = next((i for i, outcome in enumerate(found) if outcome in FINAL), None)
        if final is None:
            continue
        finals += 1
        for _ in range(4):
            more = [(t - START + steps[final][0], s) for t, s in generate.trace(rng, rng.randint(1, 8))]
            later = truths(formula, [*steps[: final + 1], *more], time)[final:]
            assert set(later) == {found[final] is Outcome.TRUE}, (
                f"case {number}: {render(formula, time)}\n{steps} {more}"
            )
    assert finals > CASES / 20


STEPS: list[TimedSignals] = [(1, {"a": True}), (2, {"a": False}), (3, {"b": 7})]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("not historically {a}", "currently_false true true"),
        ("historically {a} -> {b}", "currently_false true true"),
        ("once {a == false} and once {a}", "currently_false true true"),
        ("historically[:1] {a}", "currently_true currently_false currently_false"),
        ("once[2:] {a}", "currently_false currently_false true"),
        ("pre once {a}", "currently_false true true"),
        ("once {a} since {a == false}", "currently_false true true"),
        ("historically {a} since[:1] {a}", "currently_true currently_false currently_false"),
        ("exists[v]. once {a: *v} and once {b: *v}", "currently_false currently_false currently_false"),
        ("exists[v]. once {a: *v} and historically {a}", "currently_true false false"),
        ("forall[v]. {b: *v} -> once {a: *v}", "currently_true currently_true currently_false"),
        ("forall[v]. historically ({b: *v} -> once {a: *v})", "currently_true currently_true false"),
        ("once[:5] {a} or once {a}", "true true true"),
        ("historically ({a} or {b: 7})", "currently_true false false"),
        ("once[1:2] once {a}", "currently_false true true"),
        ("exists[v]. {a: *v} and historically {b}", "false false false"),
        ("exists[v]. not {a: *v} or once {b: *v}", "currently_true currently_true true"),
        (
            "exists[w]. not once {a: *w} and (exists[v]. {a: *v, b: *w} and historically {b})",
            "false false false",
        ),
        ("exists[v]. once[2:] ({a: *v} and historically {a})", "currently_false currently_false true"),
    ],
)
def test_final_as_soon_as_it_is_decided(text: str, expected: str) -> None:
    formula = parse_formula(text)
    assert [str(o) for o in outcomes(NativeEngine(formula), formula, STEPS)] == expected.split()
