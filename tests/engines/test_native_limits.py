"""Formulas that explode: the native engine gives up before a step takes long, and never where steps cost little."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from oracle_server.core.engine import MAX_WORK, MAX_WORK_ON_AVERAGE
from oracle_server.core.errors import EngineError
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.tree import Formula, Scalar
from oracle_server.engines.native import NativeEngine, timeline
from tests.brute import TimedSignals
from tests.engines.test_against_brute import matches

SHARE = 0.1
"""Of what an engine may cost: what costs less is tested sooner."""
THIRTY = [f"x{i}" for i in range(30)]
EXPLODING = [
    "forall[x,y,z]. historically[:1000] (not {a: *x} or not once[3:]{b: *y} or not once[:50]{c: *z})",
    "exists[x,y,z]. pre({a: *x} or {b: *y}) and (once[:100]{b: *y} or pre{c: *z})",
    "exists[x,y,z]. (not {a: *x} or {b: *y} or {c: *z}) since[:500] ({a: *x} or {b: *y} or {c: *z})",
    f"exists[{','.join(THIRTY)}]. " + " and ".join(f"(once{{a: *{x}}} or once{{b: *{x}}})" for x in THIRTY),
]


def traffic(count: int) -> list[TimedSignals]:
    """Steps of values that never came before, a hundred a second."""
    steps: list[TimedSignals] = []
    for i in range(1, count + 1):
        signals: dict[str, Scalar] = {"a": i, "b": i * 7, "c": i * 11, "d": i % 2}
        if i % 3 == 1:
            del signals["b"]
        if i % 5 == 1:
            del signals["a"]
        steps.append((i * 10**7, signals))
    return steps


def run(engine: NativeEngine, formula: Formula, steps: Sequence[TimedSignals]) -> list[int]:
    """What each step cost."""
    costs = []
    for time, found in matches(formula, steps):
        engine.step(time, found)
        costs.append(engine.work)
    return costs


@pytest.mark.parametrize("text", EXPLODING)
def test_an_engine_gives_up_before_a_step_costs_too_much(text: str) -> None:
    formula = parse_formula(text, "steps")
    engine = NativeEngine(formula, share=SHARE)
    with pytest.raises(EngineError, match="cost too much"):
        run(engine, formula, traffic(20_000))
    assert engine.work <= 2 * MAX_WORK * SHARE


def test_what_is_told_apart_has_an_end_though_steps_may_cost_much(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline, "MAX_APART", 500)
    formula = parse_formula(EXPLODING[2], "steps")
    with pytest.raises(EngineError, match=r"more than 500 .* distinguished"):
        run(NativeEngine(formula, share=10**6), formula, traffic(1_000))


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_a_formula_whose_steps_cost_little_goes_on_for_ever(time: Time) -> None:
    text = "forall[x]. {a: *x} -> once[:100]{b: *x} or not once{a: *x} or (exists[y]. {b: *y, c: *x})"
    formula = parse_formula(text, time)
    engine = NativeEngine(formula, time)
    assert max(run(engine, formula, traffic(2_000))) < MAX_WORK_ON_AVERAGE * SHARE


def test_a_step_may_cost_much_now_and_then() -> None:
    """One that looks at thousands of values, and a hundred that look at none."""
    formula = parse_formula("exists[x]. once{a: *x} and {d: 2}", "steps")
    engine = NativeEngine(formula, share=SHARE)
    costs = run(engine, formula, [(i, {"a": i}) for i in range(1, 2_001)])
    for i in range(5):
        costs += run(engine, formula, [(30_000 + i, {"d": 2}), *((30_000 + i, {}) for _ in range(100))])
    assert max(costs) > 3 * MAX_WORK_ON_AVERAGE * SHARE
    with pytest.raises(EngineError):
        run(engine, formula, [(40_000 + i, {"d": 2 * (i % 2)}) for i in range(100)])


def test_what_is_taken_back_costs_nothing_later() -> None:
    formula = parse_formula("exists[x]. once{a: *x} and {d: 2}", "steps")
    engine, alike = NativeEngine(formula, share=SHARE), NativeEngine(formula, share=SHARE)
    for one in (engine, alike):
        run(one, formula, [(i, {"a": i}) for i in range(1, 1_001)])
    for _ in range(30):
        engine.mark()
        run(engine, formula, [(20_000, {"d": 2})])
        engine.back()
    rest: list[TimedSignals] = [(30_000 + i, {"d": 2 * (i % 2)}) for i in range(8)]
    assert run(engine, formula, rest) == run(alike, formula, rest)


def test_a_restored_engine_gives_up_where_the_other_does() -> None:
    formula = parse_formula(EXPLODING[2], "steps")
    engine, limits = NativeEngine(formula, share=SHARE), []
    steps = list(matches(formula, traffic(1_000)))
    for time, found in steps[:4]:
        engine.step(time, found)
    other = NativeEngine(formula, share=SHARE)
    other.restore(engine.snapshot())
    for one in (engine, other):
        for place, (time, found) in enumerate(steps[4:]):
            try:
                one.step(time, found)
            except EngineError:
                limits.append(place)
                break
    assert len(limits) == 2
    assert limits[0] == limits[1] > 0
