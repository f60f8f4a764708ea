"""The native engine against the formula table, on thousands of random cases with quantifiers nested three deep.

    CASES=50000 pytest tests/engines/test_native_random.py

is the long run, with JOINED=0.5 half of its formulas have parts that bind each other's variables, and with RELATED=1
those that have variables have relations between them where they can. A case is told by its number and these shares.
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable

import pytest

from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals, truths
from tests.engines.test_against_brute import SEED, holds, outcomes

CASES = int(os.environ.get("CASES", "3000"))


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_every_case_is_judged_as_the_table_says(time: Time) -> None:
    for number in range(SEED, SEED + CASES):
        check(time, number)


Making = Callable[[random.Random, Time, int], Formula]


def case(time: Time, number: int, make: Making = generate.either) -> tuple[Formula, list[TimedSignals]]:
    """A formula and a trace."""
    rng = random.Random(f"{time} {number}")
    return make(rng, time, rng.randint(2, 5)), generate.trace(rng, rng.randint(3, 14))


def check(time: Time, number: int, make: Making = generate.either) -> None:
    formula, steps = case(time, number, make)
    found = [holds(outcome) for outcome in outcomes(NativeEngine(formula, time), formula, steps)]
    assert found == truths(formula, steps, time), f"case {number}, {time}: {render(formula, time)}\n{steps}"


@pytest.mark.parametrize(
    ("time", "number"),
    [("steps", 1016563), ("seconds", 1028502), ("seconds", 1086800)],
    ids=["quantifier under pre", "quantifier under once", "quantifier under since"],
)
def test_cases_that_were_once_judged_wrong(time: Time, number: int) -> None:
    check(time, number, generate.formula)
