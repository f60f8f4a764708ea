"""Native and reelay side by side."""

from __future__ import annotations

import os

import pytest

from oracle_server.core.atoms import Matches
from oracle_server.core.errors import EngineError
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.both import BothEngine
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.table import make_engine
from tests import generate
from tests.brute import truths
from tests.engines.test_against_brute import SEED, holds, outcomes
from tests.engines.test_native_random import case

CASES = int(os.environ.get("CASES", "200"))
BLOCKS = 2
"""The cases are judged in so many tests, side by side: reelay takes 20 ms to make a monitor."""


@pytest.mark.parametrize("block", range(BLOCKS))
def test_both_agree_on_cases_of_the_random_suite(block: int) -> None:
    """Of the cases that native is compared with the formula table on: each without relations is for reelay too."""
    for number in range(SEED + block, SEED + CASES, BLOCKS):
        formula, steps = case("steps", number, generate.plain)
        engine = make_engine(Property("p", formula, engine="both"))
        assert isinstance(engine, BothEngine)
        found = [holds(o) for o in outcomes(engine, formula, steps)]
        told = f"case {number}: {render(formula)}\n{steps}"
        assert engine.complaint is None, told
        if number % 20 == 0:
            assert found == truths(formula, steps, "steps"), told


class Contrary:
    """Says the contrary from its third step on, and gives up at its fifth."""

    def __init__(self) -> None:
        self.steps = 0

    def step(self, time: int, matches: Matches) -> Outcome:
        self.steps += 1
        if self.steps == 5:
            raise EngineError("enough")
        return Outcome.CURRENTLY_TRUE if self.steps < 3 else Outcome.CURRENTLY_FALSE


def test_a_difference_is_told_and_changes_no_verdict() -> None:
    formula, other = parse_formula("not {a}"), Contrary()
    engine = BothEngine(NativeEngine(formula), other)
    assert [engine.step(n, [None]) for n in range(8)] == [Outcome.CURRENTLY_TRUE] * 8
    assert engine.complaint == "at step 3 native says currently_true, and reelay currently_false"
    assert other.steps == 5, "asked no more once it can't judge"


def test_what_reelay_cannot_judge_native_judges_alone() -> None:
    prop = Property("p", parse_formula("once[:5] {a}", "seconds"), time="seconds", engine="both")
    assert isinstance(make_engine(prop), NativeEngine)
