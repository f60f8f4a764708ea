"""With bounds everywhere, what the native engine keeps follows the window and not the run."""

from __future__ import annotations

import json
import os
import random
from typing import Any

import pytest

from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Bound, Formula
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals
from tests.engines.test_against_brute import SEED, outcomes
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "300"))


def bounded(formula: Formula, unit: int) -> Formula:
    """The formula with an end to each of its bounds."""
    parts: dict[str, Any] = {
        name: bounded(part, unit)
        for name in ("operand", "left", "right", "body")
        if (part := getattr(formula, name, None)) is not None
    }
    if isinstance(formula, tree.Once | tree.Historically | tree.Since):
        parts["bound"] = Bound(formula.bound.lower, formula.bound.upper or formula.bound.lower + 3 * unit)
    if isinstance(formula, tree.Exists | tree.Forall):
        parts["variable"] = formula.variable
    return type(formula)(**parts) if parts else formula


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_fresh_values_at_every_step_leave_nothing_behind(time: Time) -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"memory {time} {number}")
        formula = bounded(generate.formula(rng, time, rng.randint(2, 4), 2), 1 if time == "steps" else SECOND)
        engine, sizes = NativeEngine(formula, time), []
        for turn in range(6):
            steps: list[TimedSignals] = []
            for n in range(turn * 40, turn * 40 + 40):
                signals = {key: rng.choice((n, n // 2, "x")) for key in generate.KEYS if rng.random() < 0.7}
                steps.append((n * SECOND, signals))
            outcomes(engine, formula, steps)
            sizes.append(_kept(engine))
        told = f"case {number}, {time}: {render(formula, time)} keeps {sizes}"
        assert max(sizes[3:]) <= 2 * max(sizes[:3]) + 20, told


def _kept(engine: NativeEngine) -> int:
    """How many keys an engine tells apart, as its snapshot shows them; times of steps are kept in blocks."""
    data = engine.snapshot()
    return json.dumps(data["nodes"]).count('"') // 2


def test_two_values_in_windows_leave_nothing_behind() -> None:
    """What is told apart along one variable is told apart for the values of the other too, and forgotten with them."""
    text = "forall[i]. forall[j]. {r: *i, s: *j} -> once[:20] ({q: *i} since[:10] {p: *j})"
    formula, sizes = parse_formula(text), list[int]()
    engine = NativeEngine(formula)
    for turn in range(4):
        steps: list[TimedSignals] = [(n, {"rqps"[n % 4]: n, "s": n}) for n in range(turn * 60, turn * 60 + 60)]
        outcomes(engine, formula, steps)
        sizes.append(_kept(engine))
    assert sizes[-1] <= sizes[0] + 5, sizes
