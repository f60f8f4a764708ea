"""Explanations: what they say, and that they say enough."""

from __future__ import annotations

import os
import random
from collections.abc import Iterable, Iterator

import pytest

from oracle_server.core.explanation import Reason
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Constraint, Formula
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals, truths
from tests.engines.test_against_brute import SEED, matches
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "1000"))


def explained(reasons: Iterable[Reason], last: int) -> Iterator[int]:
    """The numbers of the steps that reasons speak of; those since a window matter where something held ever since."""
    for reason in reasons:
        if reason.parts:
            yield from explained(reason.parts, last)
        elif reason.at is None and reason.window is None and reason.text.startswith("for "):
            yield from range(1, last + 1)  # said of all values: of all steps
        elif " since" in reason.formula:
            yield from range(reason.at or (reason.window or (last + 1,))[0], last + 1)
        elif reason.window is not None:
            yield from range(reason.window[0], reason.window[1] + 1)
        elif reason.at is not None:
            yield reason.at


def simple_formula(rng: random.Random) -> Formula:
    """Quantifiers around a Boolean combination of temporal operators, and nothing temporal or quantified below."""

    def atomic(scope: tuple[str, ...]) -> Formula:
        part = generate.formula(rng, "steps", 0, 0, scope)
        return tree.Not(part) if rng.random() < 0.3 else part

    def past(scope: tuple[str, ...]) -> Formula:
        bound = generate.bound(rng, "steps")
        kind = rng.randrange(5)
        if kind == 0:
            return tree.Since(atomic(scope), atomic(scope), bound)
        return (tree.Once(atomic(scope), bound), tree.Historically(atomic(scope), bound),
                tree.Pre(atomic(scope)), atomic(scope))[kind - 1]  # fmt: skip

    scope = tuple("xy"[: rng.randrange(3)])
    formula: Formula = rng.choice((tree.And, tree.Or, tree.Implies))(past(scope), past(scope))
    for name in reversed(scope):
        use = tree.Atom((Constraint("a", "==", tree.Ref(name)),))
        kind = rng.choice((tree.Exists, tree.Forall))
        formula = kind(name, tree.And(use, formula) if kind is tree.Exists else tree.Implies(use, formula))
    return formula


def test_the_explained_steps_alone_make_the_same_outcome() -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"explain {number}")
        formula = simple_formula(rng)
        engine, steps = NativeEngine(formula), generate.trace(rng, 10)
        for last, (time, found) in enumerate(matches(formula, steps), start=1):
            engine.step(time, found)
            why = engine.explain()
            kept = {*explained(why.reasons, last), last}
            alone: list[TimedSignals] = [(t, s if n in kept else {}) for n, (t, s) in enumerate(steps[:last], start=1)]
            told = f"case {number}, step {last}: {render(formula)}\n{steps[:last]}\n{why.text}"
            assert truths(formula, steps[:last], "steps")[-1] is why.holds, told
            assert truths(formula, alone, "steps")[-1] is why.holds, told


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_every_formula_can_be_explained(time: Time) -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"any {time} {number}")
        formula = generate.formula(rng, time, rng.randint(2, 5))
        engine, steps = NativeEngine(formula, time), generate.trace(rng, 6)
        for (at, found), holds in zip(matches(formula, steps), truths(formula, steps, time), strict=True):
            engine.step(at, found)
            why = engine.explain()
            assert why.holds is holds, f"case {number}, {time}: {render(formula, time)}"
            assert all(leaf.text and leaf.formula for leaf in why.leaves)


TRACE: list[TimedSignals] = [
    (10 * SECOND, {"topic": "/in", "id": 7}),
    (11 * SECOND, {"topic": "/in", "id": 8}),
    (12 * SECOND, {"topic": "/out", "id": 9}),
    (15 * SECOND, {"topic": "/out", "id": 8}),
]


@pytest.mark.parametrize(
    ("time", "text", "expected"),
    [
        (
            "steps",
            'forall[i]. once[2:]{topic: "/in", id: *i} -> once{topic: "/out", id: *i}',
            'for i = 7: once[2:] {topic: "/in", id: 7}: held at step 1; once {topic: "/out", id: 7}: none in steps 1–4',  # noqa: RUF001
        ),
        (
            "steps",
            'historically[:2] {topic: "/in"}',
            'historically[:2] {topic: "/in"}: does not hold at step 4',
        ),
        ("steps", '{topic: "/in"} and {id: 8}', '{topic: "/in"}: does not hold at step 4'),
        ("steps", 'exists[i]. {topic: "/none", id: *i}', 'exists[i]. {topic: "/none", id: *i}: for no value'),
        ("steps", "pre pre pre pre {id}", "pre pre pre pre {id}: its operand did not hold at step 3"),
        ("seconds", 'once[:2]{topic: "/in"}', 'once[:2s] {topic: "/in"}: none in the last 2s'),
        (
            "seconds",
            'historically[2:5] {topic: "/in"}',
            'historically[2s:5s] {topic: "/in"}: did not hold at a step 3s ago',
        ),
        (
            "seconds",
            '{topic: "/none"} since[1:] {topic: "/in"}',
            '{topic: "/none"} since[1s:] {topic: "/in"}: none with its left side ever since 1s ago or earlier',
        ),
    ],
)
def test_what_an_explanation_says(time: Time, text: str, expected: str) -> None:
    formula = parse_formula(text, time)
    engine = NativeEngine(formula, time)
    for at, found in matches(formula, TRACE):
        engine.step(at, found)
    assert engine.explain().text == expected
