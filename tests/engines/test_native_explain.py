"""Explanations: what they say, and that they say enough."""

from __future__ import annotations

import os
import random
from dataclasses import replace

import pytest

from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Call, Formula
from oracle_server.core.past import Past
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.native.reasons import spots
from tests import generate
from tests.brute import TimedSignals, truths
from tests.engines.test_against_brute import SEED, matches
from tests.strategies import SECOND, free

CASES = int(os.environ.get("CASES", "100"))


def named(rng: random.Random, formula: Formula) -> Formula:
    """The same formula, in half of the cases with names for some of its parts."""
    share = rng.choice((0, 0.4))

    def change(node: Formula) -> Formula:
        lasts = isinstance(node, tree.Since) and node.bound.upper is None and rng.random() < 0.4
        if (
            isinstance(node, tree.Since) and lasts and {*free(node.left)} <= {*free(node.right)}
        ):  # else one binds nothing
            node = replace(node, left=node.right)
        call = Call(f"n{rng.randint(0, 9)}", tuple(free(node)))
        return replace(tree.rebuilt(node, change), written=call if rng.random() < share else None)

    return change(formula)


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_the_explained_steps_alone_make_the_same_outcome(time: Time) -> None:
    shorter = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"explain {time} {number}")
        formula = named(rng, generate.either(rng, time, rng.randint(2, 5)))
        engine, steps = NativeEngine(formula, time), generate.trace(rng, 10)
        told = list(matches(formula, steps))
        for last, (at, found) in enumerate(told, start=1):
            engine.step(at, found)
            past = Past([t for t, _ in told[:last]], [m for _, m in told].__getitem__, effort=10**6)
            why = engine.explain(past)
            spans = [*spots(why.reasons)]
            kept = [
                s if n == last or any(a <= (n if time == "steps" else t) <= b for a, b in spans) else {}
                for n, (t, s) in enumerate(steps[:last], start=1)
            ]
            shorter += {} in kept
            alone: list[TimedSignals] = [(t, s) for (t, _), s in zip(steps, kept, strict=False)]
            shown = f"case {number}, {time}, step {last}: {render(formula, time)}\n{steps[:last]}\n{why}"
            assert truths(formula, steps[:last], time)[-1] is why.holds, shown
            assert truths(formula, alone, time)[-1] is why.holds, shown
    assert shorter > CASES


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_every_formula_can_be_explained(time: Time) -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"any {time} {number}")
        formula = named(rng, generate.either(rng, time, rng.randint(2, 5)))
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
