"""Episodes where late events are put in their places: those of the rows as they stand, with restarts and without."""

from __future__ import annotations

import dataclasses
import os
import random
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

import pytest
from msgspec.structs import replace

from oracle_server.core.formula.parse import Time
from oracle_server.core.verdicts import Judged
from tests.core.revising import Case, Run, case, in_order
from tests.engines.test_against_brute import SEED
from tests.episodes import Kept, Line, expected, told
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "200"))
DIFFERED = (3666412842, 3666412941)
"""Of these a deadline had another number after a restart, and an end was told twice."""


@dataclass
class Following(Run):
    """A run of which a history keeps the episodes."""

    kept: Kept = field(default_factory=Kept)

    def take(self, judged: Iterable[Judged]) -> None:
        rows = list(judged)
        self.kept.take(rows)
        super().take(rows)


def standing(run: Run) -> list[list[Line]]:
    """The lines of each property as they stand, in the order of publication."""
    width = len(run.case.spec.properties)
    numbers: dict[tuple[str, int], tuple[int, bool]] = {}
    ticks: defaultdict[int, list[int]] = defaultdict(list)
    for position, row in run.book.first.items():
        n = (position - 1) * width + 1
        if row.step.event.monitor:
            numbers[row.step.event.monitor, row.step.event.seq] = n, row.number is None and not row.step.skipped
        elif run.book.stands(position).outcomes[0] is not None:
            ticks[row.step.stamp].append(n)
    lines: list[list[Line]] = [[] for _ in range(width)]
    latest = 0
    for row, present in in_order(run):
        event, latest = row.step.event, max(latest, present)
        n, attempt = numbers[event.monitor, event.seq] if event.monitor else (ticks[row.step.stamp].pop(0), False)
        for i, verdict in enumerate(row.verdicts):
            violations = int(verdict.explanation is not None)
            lines[i].append(Line(n + i, latest, verdict.outcome.current, violations, attempt))
    return lines


@pytest.mark.parametrize("restarts", [0, 0.15])
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_episodes_are_those_of_the_rows_as_they_stand(time: Time, restarts: float) -> None:
    found, revised = 0, 0
    for number in (*DIFFERED, *range(SEED, SEED + CASES)):
        rng = random.Random(f"episodes {time} {number}")
        spec, events = case(rng, time)
        spec = dataclasses.replace(spec, gap=rng.choice((0, SECOND, 4 * SECOND)))
        run = Following(Case(spec, events), divided=rng.random() < 0.5, restarts=restarts)
        run.judge(rng)
        name = f"case {number}, {time}: " + "; ".join(p.text for p in spec.properties)
        for i, lines in enumerate(standing(run)):
            wanted = sorted(told(expected(lines, spec.gap)), key=lambda episode: (episode.began, episode.first))
            have = [replace(episode, final=False) for episode in told(run.kept.of(i))]
            assert have == wanted, name
            found += len(wanted)
        revised += len(run.book.revisions)
    assert found > CASES / 2
    assert revised > CASES / 10
