"""Parts of formulas at each step, against the formula table."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, seed
from hypothesis import strategies as st

from oracle_server.core.formula.definitions import defined
from oracle_server.core.formula.outline import Row, outline
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula
from oracle_server.engines.native.watched import WatchedEngine
from tests import generate, strategies
from tests.brute import TimedSignals, truths
from tests.engines.test_against_brute import SEED, holds, matches, some
from tests.engines.test_native_random import CASES

MOST = 200


def watched(
    formula: Formula, steps: list[TimedSignals], time: Time, restored: int = 0
) -> tuple[list[Row], list[list[bool | None]]]:
    """The rows of a formula, and the truth of each at each step; with a snapshot taken after so many steps."""
    rows = outline(formula, time, MOST)
    engine, found = WatchedEngine(formula, time, rows), []
    for number, (at, seen) in enumerate(matches(formula, steps)):
        if number == restored:
            engine, known = WatchedEngine(formula, time, rows), engine
            if number:
                engine.restore(known.snapshot())
        engine.watching = range(2**63)
        outcome = engine.step(at, seen)
        assert engine.outcome is outcome
        assert engine.truths[0] is holds(outcome), "the whole is what is judged"
        found.append(engine.truths)
    return rows, found


def compare(formula: Formula, steps: list[TimedSignals], time: Time, restored: int = 0) -> None:
    rows, found = watched(formula, steps, time, restored)
    for place, row in enumerate(rows):
        told = [truth[place] for truth in found]
        if row.is_told:
            known = truths(row.part, steps, time)
            where = f"{row.path} of {render(formula, time)}\n{steps}"
            assert [one if one is not None else other for one, other in zip(told, known, strict=True)] == known, where
            assert None not in told or row.head.startswith(("exists", "forall")), where
        else:
            assert set(told) <= {None}


@pytest.mark.parametrize("time", ["steps", "seconds"])
@seed(SEED)
@some
@given(data=st.data())
def test_each_part_is_as_the_table_says(time: Time, data: st.DataObject) -> None:
    formula = data.draw(strategies.formulas(time, data.draw(st.integers(1, 4))))
    steps = data.draw(strategies.traces())
    compare(formula, steps, time, data.draw(st.integers(0, len(steps))))


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_so_is_each_part_of_nested_quantifiers(time: Time) -> None:
    for number in range(SEED, SEED + CASES // 10):
        rng = random.Random(f"{time} {number}")
        compare(generate.formula(rng, time, rng.randint(2, 5)), generate.trace(rng, rng.randint(3, 14)), time)


def test_rows_say_what_parts_are() -> None:
    text = "forall[g]. {goal: *g} -> first or lasting[2] (once[:3] {v > 1} and not true)"
    rows = outline(parse_formula(text), "steps", MOST)
    assert [(row.depth, row.head, row.needs) for row in rows] == [
        (0, "forall[g].", ()),
        (1, "->", ("g",)),
        (2, "{goal: *g}", ("g",)),
        (2, "or", ()),
        (3, "first", ()),
        (3, "lasting[2]", ()),
        (4, "and", ()),
        (5, "once[:3]", ()),
        (6, "{v > 1}", ()),
        (5, "false", ()),
    ]
    assert not any(row.more or row.waits for row in rows)


def test_a_large_formula_is_told_as_far_as_there_is_room() -> None:
    rows = outline(parse_formula(" and ".join(f"once {{v: {i}}}" for i in range(20))), "steps", 31)
    assert [row.depth for row in rows] == [0, *[1, 2] * 10, *[1] * 10]
    assert [row.text for row in rows if row.more] == [f"once {{v: {i}}}" for i in range(10, 20)]
    rows = outline(rows[0].part, "steps", 6)
    assert [(row.text[:9], row.more) for row in rows] == [
        ("once {v: ", True), *[(f"once {{v: {i}}}"[:9], True) for i in range(5)]
    ]  # fmt: skip


def test_what_has_a_name_stands_by_itself() -> None:
    formula = parse_formula("both and {c}", "steps", defined({"both": "{a} and {b}"}, []))
    assert [(row.depth, row.name) for row in outline(formula, "steps", MOST)] == [
        (0, None), (1, "both"), (2, None), (2, None), (1, None)
    ]  # fmt: skip
