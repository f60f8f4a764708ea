"""Steps of the native engine that are taken back, and the deadlines between its steps."""

from __future__ import annotations

import json
import os
import random
from collections.abc import Sequence
from typing import Any

import pytest

from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals, truths
from tests.engines.test_against_brute import SEED, holds, matches
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "100"))


def saved(engine: NativeEngine) -> str:
    """All of an engine's state, in an order that does not depend on how it came about."""
    return json.dumps(_sorted(json.loads(json.dumps(engine.snapshot()))))


def _sorted(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _sorted(value) for key, value in data.items()}
    return sorted(map(_sorted, data), key=json.dumps) if isinstance(data, list) else data


def judge(engine: NativeEngine, formula: Formula, steps: Sequence[TimedSignals]) -> list[Outcome]:
    return [engine.step(time, found) for time, found in matches(formula, steps)]


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_steps_that_are_taken_back_leave_nothing_behind(time: Time) -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"back {time} {number}")
        formula = generate.either(rng, time, rng.randint(2, 5))
        engine = NativeEngine(formula, time)
        steps = generate.trace(rng, rng.randint(3, 10))
        for now in range(len(steps)):
            for _ in range(rng.randint(0, 2)):
                before = saved(engine)
                engine.mark()
                others = [(t + steps[now][0], s) for t, s in generate.trace(rng, rng.randint(1, 6))]
                tried = [holds(o) for o in judge(engine, formula, others)]
                told = f"case {number}, {time}: {render(formula, time)}\n{steps[:now]} {others}"
                assert tried == truths(formula, [*steps[:now], *others], time)[now:], told
                engine.back()
                assert saved(engine) == before, told
            (outcome,) = judge(engine, formula, steps[now : now + 1])
            assert holds(outcome) == truths(formula, steps[: now + 1], time)[-1], f"case {number}, {time}"


def test_between_two_deadlines_time_alone_changes_nothing() -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"deadline {number}")
        formula = generate.either(rng, "seconds", rng.randint(2, 4))
        engine = NativeEngine(formula, "seconds")
        steps = generate.trace(rng, rng.randint(2, 8))
        judge(engine, formula, steps)
        after = steps[-1][0]
        while True:
            deadline = engine.next_deadline(after)
            last = after + 10 * SECOND if deadline is None else deadline - 1
            assert last >= after
            times = {after + 1, (after + last) // 2, last} - {after} if last > after else set()
            outcomes = {truths(formula, [*steps, (time, {})], "seconds")[-1] for time in times}
            assert len(outcomes) <= 1, f"case {number}: {render(formula, 'seconds')}\n{steps} {after} {deadline}"
            if deadline is None:
                break
            after = deadline


@pytest.mark.parametrize("atom", ['{topic: "/b", v <= *x}', '{topic: "/b", v: *x}'])
def test_an_atom_that_had_not_held_does_not_after_going_back(atom: str) -> None:
    formula = parse_formula(f'forall[x]. {{topic: "/a", v: *x}} -> eventually[:9s] {atom}', "seconds")
    engine = NativeEngine(formula, "seconds")
    judge(engine, formula, [(SECOND, {"topic": "/c"})])
    before = engine.snapshot()
    engine.mark()
    judge(engine, formula, [(2 * SECOND, {"topic": "/b", "v": 1.0})])
    assert engine.snapshot()["nodes"] != before["nodes"]
    engine.back()
    assert engine.snapshot() == before
