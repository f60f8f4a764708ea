"""Rows of random sessions that revise are told as they stand, however early they are let go of."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import pytest

from oracle_server.core.spec import SECOND
from oracle_server.core.verdicts import Judged
from oracle_server.replay import settling
from oracle_server.replay.run import changeable
from oracle_server.replay.settling import Settled, Settling
from tests.core.revising import Run, case


@dataclass
class Told(Run):
    """A run of which is told what stands, as soon as it can be."""

    settling: Settling | None = None
    told: list[Settled] = field(default_factory=list)
    early: int = 0
    """How many rows were told before the end."""

    def take(self, judged: Iterable[Judged]) -> None:
        if self.settling is None:
            names = tuple(prop.id for prop in self.case.spec.properties)
            self.settling = Settling(
                names, "standing", lambda: changeable(self.session), lambda _: None, lambda _: None
            )
        group = list(judged)
        super().take(group)
        self.told += self.settling.take(group)

    def end(self) -> None:
        assert self.settling is not None
        self.early = len(self.told)
        self.told += self.settling.rest()


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_what_is_told_is_what_stands_at_the_end(
    time: Literal["steps", "seconds"], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(settling, "_EVERY", 0)
    revised = early = 0
    for seed in range(300):
        rng = random.Random(seed)
        run = Told(case(rng, time, horizon=rng.choice([3, 8, 60]) * SECOND), divided=rng.random() < 0.3)
        run.judge(rng)
        run.end()
        width = run.book.width
        stands = {p: run.book.stands(p) for p in run.book.first}
        told = {(row.told[0]["n"] - 1) // width + 1: row for row in run.told}
        assert list(told) == sorted(told)
        assert set(told) == {p for p, standing in stands.items() if any(standing.outcomes)}, f"case {seed}"
        for position, row in told.items():
            wanted = [outcome for outcome in stands[position].outcomes if outcome]
            assert [v.outcome for v in row.verdicts] == wanted, f"case {seed}"
            violated = {(r["n"] - 1) % width for r in row.told if r["violation"]}
            assert violated == set(stands[position].explanations), f"case {seed}"
        revised += sum("revised" in r for row in run.told for r in row.told)
        early += run.early
    assert revised > 20
    assert early > 20
