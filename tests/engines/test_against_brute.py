"""Every engine against the formula table, on random formulas and traces. A new engine joins in `MAKERS`."""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate

import pytest
from hypothesis import HealthCheck, event, given, seed, settings
from hypothesis import strategies as st

from oracle_server.core.atoms import Match, Matches, canonical, specialise
from oracle_server.core.engine import Engine
from oracle_server.core.errors import EngineError
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula, Scalar
from oracle_server.core.verdicts import FINAL, NEGATIVE, Outcome
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.reelay import MAX_BOUND, ReelayEngine, refusal
from tests import strategies
from tests.brute import TimedSignals, truths
from tests.strategies import SECOND

Maker = Callable[[Formula], Engine]

MAKERS: dict[tuple[str, Time], Maker] = {
    ("reelay", "steps"): ReelayEngine,
    ("native", "steps"): NativeEngine,
    ("native", "seconds"): lambda formula: NativeEngine(formula, "seconds"),
}
"""Makes a fresh engine for a formula, for each engine and each clock that it has."""

SEED = 0 if os.environ.get("CI") else int(os.environ.get("TEST_SEED") or random.randrange(2**32))
many = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
some = settings(many, max_examples=50)

each_engine = pytest.mark.parametrize(
    ("maker", "time"), [(m, k[1]) for k, m in MAKERS.items()], ids=map("-".join, MAKERS)
)


def matches(formula: Formula, steps: Sequence[TimedSignals]) -> Iterator[tuple[int, Matches]]:
    """What an engine is told of each step: its time, and what each atom of the formula makes of it."""
    atoms = tree.atoms(formula)
    tests = specialise(atoms, {}, lambda _: True)
    for time, signals in steps:
        found: list[Match] = [None] * len(atoms)
        for test in tests:
            found[test.index] = test.match(signals)
        yield time, found


def outcomes(engine: Engine, formula: Formula, steps: Sequence[TimedSignals]) -> list[Outcome]:
    return [engine.step(time, found) for time, found in matches(formula, steps)]


def holds(outcome: Outcome) -> bool:
    assert outcome is not Outcome.UNKNOWN
    return outcome not in NEGATIVE


def compare(maker: Maker, formula: Formula, steps: Sequence[TimedSignals], time: Time) -> None:
    found = [holds(outcome) for outcome in outcomes(maker(formula), formula, steps)]
    assert found == truths(formula, steps, time), f"TEST_SEED={SEED}: {render(formula, time)}\n{steps}"


@each_engine
@seed(SEED)
@many
@given(data=st.data())
def test_holds_at_every_step_what_the_table_says(maker: Maker, time: Time, data: st.DataObject) -> None:
    depth = data.draw(st.integers(1, 4))
    formula = data.draw(strategies.formulas(time, depth))
    steps = data.draw(strategies.traces())
    compare(maker, formula, steps, time)


@each_engine
@pytest.mark.parametrize(
    "text",
    [
        "once[] {a: 1}",
        "historically[] {a: 1}",
        "{a: 1} since[] {b: 1}",
        "forall[x]. {a: *x} -> once[] {b: *x}",
        "exists[x]. {a: *x} and historically[] not {b: *x}",
        "exists[x]. historically[] not {a: *x, b: *x}",
        "forall[x]. {a: *x} -> ({b} since[] {b: *x})",
        "exists[x]. ({a: *x} or {b: *x}) since[] {a: 1, b: *x}",
    ],
)
def test_every_corner_bound_on_a_long_trace(maker: Maker, time: Time, text: str) -> None:
    rng = random.Random(text)
    gaps = accumulate(rng.choice((0, SECOND - 1, SECOND, SECOND + 1)) for _ in range(60))
    values: list[Scalar] = [1, 1, "1", True]
    steps: list[TimedSignals] = [(t, {k: rng.choice(values) for k in "ab" if rng.random() < 0.8}) for t in gaps]
    for lower, upper in strategies.CORNERS:
        bound = f"[{lower}:{'' if upper is None else upper}]"
        compare(maker, parse_formula(text.replace("[]", bound), time), steps, time)


@each_engine
@seed(SEED)
@some
@given(data=st.data())
def test_no_continuation_changes_a_final_outcome(maker: Maker, time: Time, data: st.DataObject) -> None:
    body = data.draw(strategies.formulas(time, 2, ("x",)))
    bound = data.draw(st.one_of(strategies.bounds(time), st.just(tree.ALL_PAST)))
    past: list[Formula] = [tree.Once(body, bound), tree.Historically(body, bound)]
    formula = data.draw(st.sampled_from(past))
    if "x" in strategies.free(body):
        closed: list[Formula] = [tree.Exists("x", formula), tree.Forall("x", formula)]
        formula = data.draw(st.sampled_from(closed))
    steps = data.draw(strategies.traces(max_size=6))
    found = outcomes(maker(formula), formula, steps)
    final = next((i for i, outcome in enumerate(found) if outcome in FINAL), None)
    event(f"final: {final is not None}")
    if final is None:
        return
    for _ in range(3):
        more = data.draw(strategies.traces(after=steps[final][0], max_size=6))
        later = truths(formula, [*steps[: final + 1], *more], time)[final:]
        assert set(later) == {found[final] is Outcome.TRUE}, render(formula, time)


@each_engine
def test_only_an_unbounded_past_is_final_once_decided(maker: Maker, time: Time) -> None:
    steps: list[TimedSignals] = [(1, {"a": True}), (2, {"a": False}), (3, {})]
    for text, expected in (
        ("once {a == false}", ["currently_false", "true", "true"]),
        ("historically {a}", ["currently_true", "false", "false"]),
        ("exists[v]. once {a: *v}", ["true", "true", "true"]),
        ("historically[:1] {a}", ["currently_true", "currently_false", "currently_false"]),
        ("once[:1] {a == false}", ["currently_false", "currently_true", "currently_true"]),
    ):
        formula = parse_formula(text, time)
        assert outcomes(maker(formula), formula, steps) == expected


@each_engine
def test_one_is_neither_true_nor_the_text_of_one(maker: Maker, time: Time) -> None:
    """Python's 1 == True, and equal constraints in two atoms must not become one atom."""
    steps: list[TimedSignals] = [(1, {"a": 1}), (2, {"a": True}), (3, {"a": "1"}), (4, {"a": 1.0})]
    formula = parse_formula("{a: 1} and not {a: true}", time)
    found = [holds(outcome) for outcome in outcomes(maker(formula), formula, steps)]
    assert found == [True, False, False, True]


values_of_a = st.lists(st.one_of(st.integers(0, 9), st.sampled_from(("0", True, 1.0))), max_size=20)


@seed(SEED)
@some
@given(limit=st.integers(1, 4), values=values_of_a, formula=strategies.formulas(depth=3))
def test_reelay_stops_before_it_confuses_values(limit: int, values: list[Scalar], formula: Formula) -> None:
    """A variable that has taken more values than reelay can tell apart ends the judging; nothing is guessed."""
    steps: list[TimedSignals] = [(i, {"a": value}) for i, value in enumerate(values)]
    engine, expected = ReelayEngine(formula, max_values=limit), truths(formula, steps, "steps")
    for i, (time, found) in enumerate(matches(formula, steps)):
        try:
            assert holds(engine.step(time, found)) == expected[i]
        except EngineError:
            assert len({canonical(value) for value in values[: i + 1]}) > limit
            return


@pytest.mark.parametrize("text", ["exists[v]. once {a: *v, b: *v}", "forall[v]. not once {a: *v}"])
def test_reelay_counts_different_values(text: str) -> None:
    formula = parse_formula(text)
    engine = ReelayEngine(formula, max_values=2)
    same: list[TimedSignals] = [(0, {"a": v, "b": v}) for v in (7, "7", 7.0, 7, "7")]
    assert len(outcomes(engine, formula, same)) == 5
    with pytest.raises(EngineError, match="more than 2 different values"):
        outcomes(engine, formula, [(1, {"a": 8, "b": 8})])


@pytest.mark.parametrize("bound", [f"[:{MAX_BOUND + 1}]", f"[{MAX_BOUND + 1}:]"])
@pytest.mark.parametrize("operator", ["once", "historically", "{b} since"])
def test_reelay_refuses_a_bound_that_it_reads_inexactly(operator: str, bound: str) -> None:
    formula = parse_formula(f"not ({operator}{bound} {{a}})")
    assert refusal(formula, "steps")
    with pytest.raises(EngineError, match=str(MAX_BOUND)):
        ReelayEngine(formula)


def test_reelay_takes_a_large_bound_exactly() -> None:
    formula = parse_formula("once[20001:20001] {a}")
    steps: list[TimedSignals] = [(i, {"a": i == 0}) for i in range(20_003)]
    found = outcomes(ReelayEngine(formula), formula, steps)
    assert [i for i, outcome in enumerate(found) if holds(outcome)] == [20_001]


def test_reelay_refuses_seconds() -> None:
    formula = parse_formula("once[:5] {a}", "seconds")
    assert "steps" in (refusal(formula, "seconds") or "")
