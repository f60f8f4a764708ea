"""`true`, `false`, `first`, `lasting` and `{v > limit}` inside of random formulas, each read literally beside."""

from __future__ import annotations

import json
import operator
import os
import random
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest

from oracle_server.core.atoms import specialise
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Scalar
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.reelay import ReelayEngine
from tests import generate
from tests.brute import TimedSignals, truths
from tests.engines.test_against_brute import SEED, matches
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "400"))
ORDERS: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
HERE = Constraint("here", "==", value=True)
"""The atom that stands for what is written, with its truth at each step."""
Meaning = tuple[str, Callable[[Sequence[TimedSignals], Time], list[bool]]]
"""A text, and whether it holds, step by step."""


def word(rng: random.Random, _: Time) -> Meaning:
    return rng.choice(
        [
            ("true", lambda steps, _: [True for _ in steps]),
            ("false", lambda steps, _: [False for _ in steps]),
            ("first", lambda steps, _: [i == 0 for i, _ in enumerate(steps)]),
        ]
    )


def lasting(rng: random.Random, time: Time) -> Meaning:
    operand, length = generate.formula(rng, time, rng.randint(0, 2), 1), rng.randint(0, 3)
    unit = "" if time == "steps" else rng.choice(("", "s"))

    def holds(steps: Sequence[TimedSignals], time: Time) -> list[bool]:
        held = truths(operand, steps, time)
        at = [i if time == "steps" else t for i, (t, _) in enumerate(steps)]
        least = length if time == "steps" else length * SECOND
        return [any(at[i] - at[j] >= least and all(held[j : i + 1]) for j in range(i + 1)) for i in range(len(at))]

    return f"lasting[{length}{unit}] ({render(operand, time)})", holds


def comparison(rng: random.Random, _: Time) -> Meaning:
    key, other = rng.sample("abc", 2)
    op, more = rng.choice([*ORDERS]), rng.choice(("", f", {key} < 3", f", {other}: *", ", c != 7"))

    def holds(steps: Sequence[TimedSignals], _: Time) -> list[bool]:
        return [compared(signals) and also(signals) for _, signals in steps]

    def compared(signals: Mapping[str, Scalar]) -> bool:
        left, right = (signals.get(name) for name in (key, other))
        if any(value is None or isinstance(value, str | bool) for value in (left, right)):
            return False
        return bool(ORDERS[op](left, right))

    def also(signals: Mapping[str, Scalar]) -> bool:
        if more.endswith("< 3"):
            return float(signals[key]) < 3
        value = signals.get("c")
        return not more.endswith("7") or (value is not None and (value != 7 or isinstance(value, bool)))

    return f"{{{key} {op} {other}{more}}}", holds


MEANINGS = {"word": word, "lasting": lasting, "comparison": comparison}


def placed(rng: random.Random, formula: Formula) -> Formula:
    """The formula with `{here}` in place of one of its atoms that has no variable, or beside it."""
    spots = [node for node in tree.walk(formula) if isinstance(node, Atom) and not node.refs]
    if not spots:
        return rng.choice((tree.And, tree.Or, tree.Implies))(Atom((HERE,)), formula)
    spot = rng.choice(spots)

    def change(node: Formula) -> Formula:
        return Atom((HERE,)) if node is spot else tree.rebuilt(node, change)

    return change(formula)


def judged(rng: random.Random, formula: Formula, time: Time, steps: Sequence[TimedSignals]) -> list[bool]:
    """What the engine says, which takes steps back and is restored now and then."""
    engine, found = NativeEngine(formula, time), []
    for at, told in matches(formula, steps):
        if rng.random() < 0.2:
            engine.mark()
            engine.step(at + rng.randint(0, SECOND), specialised(formula, rng.choice(steps)[1]))
            engine.back()
        if rng.random() < 0.1:
            saved = json.loads(json.dumps(engine.snapshot()))
            engine = NativeEngine(formula, time)
            engine.restore(saved)
        found.append(engine.step(at, told) not in NEGATIVE)
    return found


def specialised(formula: Formula, signals: Mapping[str, Scalar]) -> list[tuple[str, ...] | None]:
    tests = specialise(tree.atoms(formula), {}, lambda _: True)
    return [test.match(signals) for test in tests]


@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize("kind", MEANINGS)
def test_a_form_means_what_its_row_says(kind: str, time: Time) -> None:
    held = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"{kind} {time} {number}")
        context = placed(rng, generate.formula(rng, time, rng.randint(0, 3)))
        text, meaning = MEANINGS[kind](rng, time)
        steps = [(at, {**signals, "kind": "topic"}) for at, signals in generate.trace(rng, 12)]
        written = render(context, time).replace("{here}", f"({text})")
        truth = meaning(steps, time)
        known = [(at, {**s, "here": holds}) for (at, s), holds in zip(steps, truth, strict=True)]
        wanted = truths(context, known, time)
        formula = parse_formula(written, time)
        assert judged(rng, formula, time, steps) == wanted, f"case {number}: {written}\n{steps}"
        assert parse_formula(render(formula, time), time) == formula
        held += any(truth) and not all(truth)
        if time == "steps" and number % 10 == 0:
            reelay = ReelayEngine(formula)
            assert [reelay.step(at, m) not in NEGATIVE for at, m in matches(formula, steps)] == wanted, written
    assert held > CASES / 20
