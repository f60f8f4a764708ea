"""What two have in common, looked up in sets that are kept: as if it were looked for among all values each time."""

from __future__ import annotations

import json
import os
import random
from dataclasses import dataclass, field

import pytest

from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula
from oracle_server.engines.native import NativeEngine, common, sought
from oracle_server.engines.native.keys import Key
from oracle_server.engines.native.matching import Matching
from oracle_server.engines.native.timeline import Timeline
from tests import generate
from tests.brute import TimedSignals
from tests.engines.test_against_brute import SEED, compare, matches
from tests.engines.test_native_joins import RACE
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "40"))


@pytest.fixture(params=[50_000, 3])
def room(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """How many sets a part keeps: plenty, or so few that it forgets them all the time."""
    monkeypatch.setattr(common, "_MOST", request.param)


def looking(formula: Formula, time: Time, monkeypatch: pytest.MonkeyPatch) -> NativeEngine:
    """An engine that looks for a value each time."""
    with monkeypatch.context() as patched:
        patched.setattr(sought, "Common", lambda *_: None)
        engine = NativeEngine(formula, time)
    engine.record()
    return engine


def keeping(formula: Formula, time: Time) -> NativeEngine:
    engine = NativeEngine(formula, time)
    engine.record()
    return engine


def matched(engine: NativeEngine) -> list[set[Key]]:
    """For which values each conjunction holds, of which the outcome tells only whether there are some."""
    return [{*node.points()} for node in engine._network.operators if isinstance(node, Matching)]


@dataclass
class Walk:
    """Steps of two engines, which are taken back together."""

    formula: Formula
    time: Time
    engines: list[NativeEngine]
    steps: list[TimedSignals] = field(default_factory=list)
    floor: int = 0
    """No step up to this one can be taken back."""

    def back(self, count: int) -> None:
        stay = max(self.floor, len(self.steps) - count)
        times = [0, 0, *(at for at, _ in self.steps)]
        for engine in self.engines:
            engine.rewind(stay, times[stay + 1], times[stay])
        del self.steps[stay:]

    def restart(self) -> None:
        """Go on with the first engine's snapshot in a new one."""
        engine = NativeEngine(self.formula, self.time)
        engine.restore(json.loads(json.dumps(self.engines[0].snapshot())))
        engine.record()
        self.engines[0], self.floor = engine, len(self.steps)

    def step(self, step: TimedSignals, *, tried: bool) -> None:
        ((now, found),) = list(matches(self.formula, [step]))
        self.steps.append(step)
        told = []
        for engine in self.engines:
            if tried:
                engine.mark()
                engine.step(now, found)
                engine.back()
            told.append((engine.step(now, found), matched(engine)))
        assert told[0] == told[1], f"{self.time}: {render(self.formula, self.time)}\n{self.steps}"


@pytest.mark.usefixtures("room")
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_it_is_as_if_it_were_looked_for_each_time(time: Time, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, meeting = [], common._Row.meeting

    def counted(row: common._Row, values: frozenset[str], timeline: Timeline) -> set[str | None]:
        asked.append(values)
        return meeting(row, values, timeline)

    monkeypatch.setattr(common._Row, "meeting", counted)
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"common {time} {number}")
        formula = generate.pairs(rng, time)
        walk = Walk(formula, time, [keeping(formula, time), looking(formula, time, monkeypatch)])
        for step in generate.trace(rng, rng.randint(10, 60)):
            if rng.random() < 0.1:
                walk.restart()
            elif rng.random() < 0.2:
                walk.back(rng.choice((1, 2, 5)))
            walk.step(step, tried=rng.random() < 0.3)
    assert len(asked) > CASES / 4


def locking(rng: random.Random, size: int) -> list[TimedSignals]:
    """Three threads that take and free locks, mostly those that they need, and read and write variables."""
    steps: list[TimedSignals] = []
    for n in range(size):
        what = rng.choice(("takes", "takes", "frees", "reads", "writes", "writes"))
        steps.append(
            (n * SECOND, {what: rng.randint(1, 3), "of" if what in ("reads", "writes") else "lock": rng.randint(1, 3)})
        )
    return steps


@pytest.mark.usefixtures("room")
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_locks_that_are_kept_no_more_are_not_in_common(time: Time, monkeypatch: pytest.MonkeyPatch) -> None:
    formula = parse_formula(RACE, time)
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"locks {time} {number}")
        walk = Walk(formula, time, [keeping(formula, time), looking(formula, time, monkeypatch)])
        for step in locking(rng, 60):
            if rng.random() < 0.1:
                walk.back(rng.choice((1, 2, 5)))
            walk.step(step, tried=rng.random() < 0.1)


@pytest.mark.usefixtures("room")
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_it_is_what_the_table_says(time: Time) -> None:
    for number in range(SEED, SEED + CASES // 20):
        rng = random.Random(f"common table {time} {number}")
        formula = generate.pairs(rng, time)
        compare(lambda formula: NativeEngine(formula, time), formula, generate.trace(rng, rng.randint(3, 9)), time)
