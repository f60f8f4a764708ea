"""The engine of robustness against the definition, and what it knows nothing of."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.atoms import canonical
from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Scalar, atoms
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.stl.engine import StlEngine
from oracle_server.engines.table import ENGINES
from tests.engines.robustness import Node, Sample, formulas, samples, value

SECOND = 10**9
START = 1_732_147_200 * SECOND
GAP: Sample = {}


class Stepped:
    """An engine, fed with signals as a property's atoms would be."""

    def __init__(self, text: str, time: Time = "steps") -> None:
        self.engine = StlEngine(text, time)
        self._names = [atom.constraints[0].key for atom in atoms(ENGINES["rtamt"].read(text, time, Names()))]

    def step(self, signals: Mapping[str, Scalar], time: int = 0) -> tuple[Outcome, float | None]:
        matches = [(canonical(signals[name]),) if name in signals else None for name in self._names]
        return self.engine.step(time, matches), self.engine.robustness


def sign(robustness: float) -> Outcome:
    if robustness == 0:
        return Outcome.UNKNOWN
    return Outcome.CURRENTLY_TRUE if robustness > 0 else Outcome.CURRENTLY_FALSE


@settings(max_examples=400, deadline=None)
@given(formulas, st.lists(samples | st.just(GAP), min_size=1, max_size=12))
def test_steps_are_judged_by_the_definition(formula: Node, events: list[Sample]) -> None:
    stepped, seen = Stepped(str(formula)), list[Sample]()
    for event in events:
        judged = stepped.step(event)
        if event is GAP or not event:
            assert judged == (Outcome.UNKNOWN, None)
            continue
        seen.append(event)
        expected = value(formula, seen, range(len(seen)), len(seen) - 1)
        assert judged == (sign(expected), expected)


@settings(max_examples=400, deadline=None)
@given(formulas, st.lists(st.tuples(st.sampled_from([0, 1, 1, 2, 5]), samples), min_size=1, max_size=12))
def test_seconds_are_judged_by_the_definition(formula: Node, events: list[tuple[int, Sample]]) -> None:
    stepped = Stepped(str(formula), "seconds")
    times = list(itertools.accumulate(passed for passed, _ in events))
    seen = [sample for _, sample in events]
    for i, sample in enumerate(seen):
        expected = value(formula, seen, times, i)
        assert stepped.step(sample, START + times[i] * SECOND) == (sign(expected), expected)


def test_equal_parts_of_a_formula_do_not_see_a_sample_twice() -> None:
    part = "historically[0:2](a > 0)"
    alone, twice = Stepped(part), Stepped(f"({part}) and (b > 0 or ({part}))")
    for a in (1, -1, 2, 3, 4, 5, -2, 1, 1, 1):
        assert twice.step({"a": a, "b": -9}) == alone.step({"a": a})


@pytest.mark.parametrize("text", ["a < 3", "a <= 3", "a == 3", "a !== 3", "not (a > 3)", "(a < 3) xor (a < 3)"])
def test_on_the_border_nothing_is_known(text: str) -> None:
    assert Stepped(text).step({"a": 3}) == (Outcome.UNKNOWN, 0)


@pytest.mark.parametrize(
    ("text", "undefined"),
    [
        ("historically(a > 0)", {"a": "9"}),
        ("historically(a > 0)", {"a": True}),
        ("historically(a > 0)", {}),
        ("historically(a + b > 0)", {"a": 1}),
        ("historically(1 / a > 0)", {"a": 0}),
        ("historically(sqrt(a) > 0)", {"a": -1}),
        ("historically(exp(a) > 0)", {"a": 10_000}),
        ("historically(pow(a, 0.5) > 0)", {"a": -2}),
        ("historically(a * 1e308 > 0)", {"a": 9}),
    ],
)
def test_what_is_no_number_is_unknown_and_no_sample(text: str, undefined: dict[str, Scalar]) -> None:
    stepped = Stepped(text)
    before = stepped.step({"a": 1, "b": 1})
    assert before[0] is Outcome.CURRENTLY_TRUE
    assert stepped.step(undefined) == (Outcome.UNKNOWN, None)
    assert stepped.step({"a": 1, "b": 1}) == before


def test_an_empty_window_is_infinitely_robust() -> None:
    assert Stepped("historically[2:5](a > 0)").step({"a": -1}) == (Outcome.CURRENTLY_TRUE, math.inf)
    assert Stepped("once[2:5](a > 0)").step({"a": 1}) == (Outcome.CURRENTLY_FALSE, -math.inf)


def test_bounds_carry_units_and_an_end_without_one_has_the_others() -> None:
    for bound in ("[0:1.5]", "[0:1500ms]", "[0s:1500ms]", "[0:1500000us]", "[0,1.5s]"):
        stepped = Stepped(f"once{bound}(a > 0)", "seconds")
        assert stepped.step({"a": 1}, START)[0] is Outcome.CURRENTLY_TRUE
        assert stepped.step({"a": -1}, START + 3 * SECOND // 2)[1] == 1
        assert stepped.step({"a": -1}, START + 3 * SECOND // 2 + 1)[1] == -1


def test_a_window_of_a_million_samples_costs_no_more_than_a_small_one() -> None:
    stepped = Stepped("(a > 0) since[0:1000000](b > 0)")
    for _ in range(2_000):
        stepped.step({"a": 1, "b": -1})
    assert stepped.step({"a": 1, "b": 2}) == (Outcome.CURRENTLY_TRUE, 2)


@pytest.mark.parametrize(
    ("text", "place", "word"),
    [
        ("eventually[0:5](a > 0)", (1, 1), "looks ahead"),
        ("(a > 0)\n  until (b > 0)", (2, 3), "looks ahead"),
        ("a > 0 unless[0:1] b > 0", (1, 7), "looks ahead"),
        ("from os import path; a > 0", (1, 1), "not expected"),
        ("float a = 3 a > 0", (1, 1), "not expected"),
        ("a > 0; b > 0", (1, 6), "not expected"),
        ("a > 0 // b", (1, 1), "comments"),
        ("a >", (1, 4), "too early"),
        ("a > 0 and\n b ~ 3", (2, 4), "no such character"),
        ("a/b > 0", (1, 1), "spaces around"),
        ("pose.x > 0", (1, 1), "dot"),
        ("a > 0 and kind > 0", (1, 11), "every event's own"),
        ("1 > 0", (1, 1), "no signal"),
        ("once[0:5s](a > 0)", (1, 5), "no unit"),
        ("once[0:0.5](a > 0)", (1, 5), "whole numbers"),
        ("a > 0 and once[3:2](a > 0)", (1, 15), "ends before"),
        ("once[0:n](a > n)", (1, 5), "numbers"),
        ("abs(a > 0) > 1", (1, 1), "not a formula"),
        ("a > 1e999", (1, 1), "too large"),
        ("(" * 900 + "a > 0" + ")" * 900, (1, 1), "too deep"),
        ("a > 0 and " * 500 + "a > 0", (1, 1), "characters"),
    ],
)
def test_what_can_not_be_judged_is_refused_at_its_place(text: str, place: tuple[int, int], word: str) -> None:
    with pytest.raises(FormulaError) as refused:
        ENGINES["rtamt"].read(text, "steps", Names())
    assert word in refused.value.message
    assert (refused.value.line, refused.value.column) == place
