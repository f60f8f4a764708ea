"""Where more rows lie within the horizon than are kept: what has no place any more is judged at the present."""

from __future__ import annotations

import os
import random

import pytest

from oracle_server.core.formula.parse import Time
from oracle_server.core.revise.kept import Keeping
from tests.core.revising import Run, case
from tests.engines.test_against_brute import SEED

CASES = int(os.environ.get("CASES", "250"))


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_each_event_is_judged_once_and_counted_so(time: Time, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Keeping.__init__, "__defaults__", (3, 0))
    beyond = placed = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"crowded {time} {number}")
        run = Run(case(rng, time), divided=rng.random() < 0.5)
        run.judge(rng)
        assert len(run.book.judged) == len(run.case.events), f"case {number}, {time}"
        assert run.session.lateness is not None
        beyond += run.session.lateness.beyond
        placed += run.session.lateness.placed
    assert beyond > CASES / 10
    assert placed > CASES / 10
