"""Snapshots: an engine that goes on from one does what the other would have done."""

from __future__ import annotations

import json
import os
import random

import pytest

from oracle_server.core.errors import EngineError
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import truths
from tests.engines.test_against_brute import SEED, holds, matches

CASES = int(os.environ.get("CASES", "500"))


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_from_a_snapshot_an_engine_goes_on_as_it_would_have(time: Time) -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"snapshot {time} {number}")
        formula = generate.either(rng, time, rng.randint(2, 5))
        steps = generate.trace(rng, rng.randint(3, 12))
        engine, kept, found = NativeEngine(formula, time), NativeEngine(formula, time), []
        for at, matched in matches(formula, steps):
            if rng.random() < 0.4:
                data = json.loads(json.dumps(engine.snapshot()))
                engine = NativeEngine(formula, time)
                engine.restore(data)
            outcome = engine.step(at, matched)
            assert outcome is kept.step(at, matched)
            assert engine.explain() == kept.explain()
            assert engine.next_deadline(at) == kept.next_deadline(at)
            found.append(holds(outcome))
        assert found == truths(formula, steps, time), f"case {number}, {time}: {render(formula, time)}\n{steps}"


def test_a_snapshot_of_another_version_is_refused() -> None:
    engine = NativeEngine(parse_formula("once {a}"))
    with pytest.raises(EngineError, match="format 0"):
        engine.restore({**engine.snapshot(), "format": 0})
