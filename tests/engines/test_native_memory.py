"""With bounds everywhere, what the native engine keeps follows the window and not the run."""

from __future__ import annotations

import json
import os
import random
from typing import Any

import pytest

from oracle_server.core.atoms import Match
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Bound, Formula
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals
from tests.engines.test_against_brute import SEED, outcomes
from tests.engines.test_obligations_random import Fed
from tests.engines.test_obligations_random import formula as obligation
from tests.obligations import Item
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "80"))


_BOUNDED = tree.Once, tree.Historically, tree.Since, tree.Eventually, tree.Always, tree.Until


def bounded(formula: Formula, unit: int) -> Formula:
    """The formula with an end to each of its bounds."""
    if isinstance(formula, tree.Relation):
        return formula
    parts: dict[str, Any] = {
        name: bounded(part, unit)
        for name in ("operand", "left", "right", "body")
        if (part := getattr(formula, name, None)) is not None
    }
    if isinstance(formula, _BOUNDED):
        parts["bound"] = Bound(formula.bound.lower, formula.bound.upper or formula.bound.lower + 3 * unit)
    if isinstance(formula, tree.Exists | tree.Forall):
        parts["variable"] = formula.variable
    return type(formula)(**parts) if parts else formula


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_fresh_values_at_every_step_leave_nothing_behind(time: Time) -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"memory {time} {number}")
        depth = rng.randint(2, 4)
        joined = number % 3 == 0  # what matches in a window varies, as values multiply
        some = generate.joined(rng, time, depth) if joined else generate.formula(rng, time, depth, 2)
        formula = bounded(some, 1 if time == "steps" else SECOND)
        engine, sizes = NativeEngine(formula, time), []
        for turn in range(12 if joined else 6):
            steps: list[TimedSignals] = []
            for n in range(turn * 40, turn * 40 + 40):
                signals = {key: rng.choice((n, n // 2, "x")) for key in generate.KEYS if rng.random() < 0.7}
                steps.append((n * SECOND, signals))
            outcomes(engine, formula, steps)
            sizes.append(_kept(engine))
        told = f"case {number}, {time}: {render(formula, time)} keeps {sizes}"
        later = min(sizes[9:]) if joined else max(sizes[3:])
        assert later <= 2 * max(sizes[:3]) + 20, told


def _kept(engine: NativeEngine) -> int:
    """How many keys an engine tells apart, as its snapshot shows them; times of steps are kept in blocks."""
    data = engine.snapshot()
    return json.dumps(data["nodes"]).count('"') // 2


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_bounded_obligations_leave_nothing_behind(time: Time) -> None:
    for number in range(SEED, SEED + min(CASES, 100)):
        rng = random.Random(f"obligations' memory {time} {number}")
        whole = bounded(obligation(rng, time), 1 if time == "steps" else SECOND)
        fed, sizes = Fed(whole, time), []
        for turn in range(12):
            for n in range(turn * 40, turn * 40 + 40):
                signals = {key: rng.choice((n, n // 2, "x")) for key in generate.KEYS if rng.random() < 0.7}
                fed.feed(Item((1000 + n) * SECOND, {**signals, "kind": "topic"}))
            sizes.append(len(json.dumps(fed.engine.snapshot()["nodes"])))
        told = f"case {number}, {time}: {render(whole, time)} takes {sizes}"
        # What is there at one moment varies; what is left behind is there at each.
        assert min(sizes[9:]) <= 2 * max(sizes[:3]) + 500, told


@pytest.mark.parametrize("operator", ["eventually[:100000]", "{held} until[:100000]"])
def test_what_was_answered_leaves_no_deadline_behind_one_that_never_is(operator: str) -> None:
    whole = parse_formula(f"forall[g]. {{goal: *g}} -> {operator} {{done: *g}}")
    engine, sizes = NativeEngine(whole), []
    held: list[Match] = [()] if "held" in operator else []
    engine.step(1, [("0",), *held, None])
    for n in range(1, 2_000):
        engine.step(2 * n, [(str(n),), *held, None])
        engine.step(2 * n + 1, [None, *held, (str(n),)])
        if n in (200, 1_999):
            sizes.append(len(json.dumps(engine.snapshot()["nodes"])))
    assert sizes[1] <= 2 * sizes[0]


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
