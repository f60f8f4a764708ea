"""The native engine goes back to any of its last steps, and goes on from there as if it had never been further."""

from __future__ import annotations

import os
import random
from dataclasses import dataclass, field

import pytest

from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals, truths
from tests.engines.test_against_brute import SEED, holds, matches

CASES = int(os.environ.get("CASES", "100"))


@dataclass
class Walk:
    """A recording engine, and the steps that stand."""

    formula: Formula
    time: Time
    steps: list[TimedSignals] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.engine = NativeEngine(self.formula, self.time)
        self.engine.record()

    def step(self, rng: random.Random, step: TimedSignals) -> None:
        ((now, found),) = list(matches(self.formula, [step]))
        marked, kept = rng.random() < 0.3, rng.random() < 0.5
        if marked:
            self.engine.mark()
        outcome = self.engine.step(now, found)
        assert holds(outcome) == truths(self.formula, [*self.steps, step], self.time)[-1], self.told(step)
        if marked and not kept:
            self.engine.back()
            return
        if marked:
            self.engine.keep()
        self.steps.append(step)

    def tick(self, rng: random.Random) -> None:
        after = self.steps[-1][0] if self.steps else 0
        deadline = self.engine.next_deadline(after)
        fresh = NativeEngine(self.formula, self.time)
        for now, found in matches(self.formula, self.steps):
            fresh.step(now, found)
            fresh.next_deadline(now)  # which lets go of those that are of no use any more
        assert deadline == fresh.next_deadline(after), self.told()
        if deadline is not None and rng.random() < 0.7:
            ((now, found),) = list(matches(self.formula, [(deadline, {})]))
            self.engine.mark()
            outcome = self.engine.step(now, found)
            self.engine.back()
            assert holds(outcome) == truths(self.formula, [*self.steps, (deadline, {})], self.time)[-1], self.told()

    def rewind(self, step: int) -> None:
        times = [0, 0, *(time for time, _ in self.steps)]
        self.engine.rewind(step, times[step + 1], times[step])
        del self.steps[step:]

    def told(self, *more: TimedSignals) -> str:
        return f"{self.time}: {render(self.formula, self.time)}\n{[*self.steps, *more]}"


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_after_going_back_it_judges_as_if_it_had_never_been_further(time: Time) -> None:
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"rewind {time} {number}")
        walk = Walk(generate.either(rng, time, rng.randint(2, 5)), time)
        forgotten = 0
        for _ in range(rng.randint(2, 5)):
            begin = walk.steps[-1][0] if walk.steps else 0
            for at, signals in generate.trace(rng, rng.randint(1, 8)):
                walk.step(rng, (begin + at, {} if rng.random() < 0.4 else signals))
                walk.tick(rng)
            if rng.random() < 0.3 and len(walk.steps) > forgotten:
                forgotten = rng.randint(forgotten + 1, len(walk.steps))
                walk.engine.forget(forgotten, walk.steps[forgotten - 1][0])
            walk.rewind(rng.randint(forgotten, len(walk.steps)))
            walk.tick(rng)
