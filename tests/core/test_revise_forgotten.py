"""Where rows are older than the horizon and kept no more, also over restarts, what stands is what it is otherwise."""

from __future__ import annotations

import os
import random

import pytest

from oracle_server.core.formula.parse import Time
from oracle_server.core.revise import rewindable
from oracle_server.core.verdicts import Judged
from tests.core import revising, revising_derived
from tests.core.revising import Run, compared, reference
from tests.engines.test_against_brute import SEED
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "400")) // 5
CASE = {"plain": revising.case, "derived": revising_derived.case}


@pytest.mark.parametrize("restarts", [0, 0.3])
@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize("kind", CASE)
def test_what_is_kept_no_more_stands_as_it_would(
    kind: str, time: Time, restarts: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rewindable, "_FORGET_AFTER", 1)
    whole = forgotten = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"forgotten {kind} {time} {number}")
        drawn = CASE[kind](rng, time, horizon=rng.choice((9, 10, 11)) * SECOND)
        run = Run(drawn, divided=rng.random() < 0.5, restarts=restarts)
        run.judge(rng)
        if not all(is_told(run, row) for row in run.book.first.values()):
            continue
        whole += 1
        assert run.session.lateness is not None
        forgotten += run.session.lateness.judge.keeping.floor > 0
        told = f"case {number}, {kind}, {time}: " + "; ".join(p.text for p in drawn.spec.properties)
        assert compared(run.stands()) == compared(reference(run)), told
        numbered = [row for row in run.book.first.values() if row.number is not None]
        assert run.session.judges["publication"].counters.steps == len(numbered), f"each is judged once: {told}"
    assert whole > CASES * 0.9
    assert forgotten


def is_told(run: Run, row: Judged) -> bool:
    """Whether a row has its place, or that is known: not of one that a restart made later than the horizon."""
    event = row.step.event
    if event.monitor and not run.case.spec.by_key[event.stream].ordered:
        return (event.monitor, event.seq) in run.keys
    return not (event.monitor and row.step.late and row.place is None)
