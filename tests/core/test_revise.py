"""What stands of a session that revises is what judging its events in the order of publication gives."""

from __future__ import annotations

import os
import random

import pytest

from oracle_server.core.formula.parse import Time
from tests.core.revising import Run, case, compared, reference
from tests.engines.test_against_brute import SEED

CASES = int(os.environ.get("CASES", "1500"))


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_what_stands_is_what_the_order_of_publication_gives(time: Time) -> None:
    revised = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"revise {time} {number}")
        run = Run(case(rng, time), divided=rng.random() < 0.5)
        run.judge(rng)
        told = f"case {number}, {time}: " + "; ".join(p.text for p in run.case.spec.properties)
        assert compared(run.stands()) == compared(reference(run)), told
        revised += len(run.book.revisions)
    assert revised > CASES / 10
