"""Episodes where late events are put in their places: those of the rows as they stand, with restarts and without."""

from __future__ import annotations

import dataclasses
import os
import random
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import pytest
from msgspec.structs import replace

from oracle_server.core import episode as episodes
from oracle_server.core.episode import Episode, Worst
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.judging.following import follow
from oracle_server.core.verdicts import Judged
from tests.core.revising import Case, Run, case, in_order
from tests.engines.test_against_brute import SEED
from tests.episodes import Kept, Line, expected, told
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "100"))
BOUNDED = ("{a <= 1}", "historically ({b: 1} -> {a < 1})", "not {b > 0}", "{a} -> {b < a} or {c < 1}")
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


Ordered = Sequence[tuple[Judged, int]]
"""The rows of a run in the order of publication, each with the present at it."""


def standing(run: Run, rows: Ordered) -> list[list[Line]]:
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
    for row, present in rows:
        event, latest = row.step.event, max(latest, present)
        n, attempt = numbers[event.monitor, event.seq] if event.monitor else (ticks[row.step.stamp].pop(0), False)
        for i, verdict in enumerate(row.verdicts):
            violations = int(verdict.explanation is not None)
            lines[i].append(Line(n + i, latest, verdict.outcome.current, violations, attempt))
    return lines


def followed(run: Run, rows: Ordered, lines: list[list[Line]]) -> list[list[Episode]]:
    """The episodes of each property, as they are followed where every event comes in its place."""
    known, found = episodes.Following(), dict[tuple[int, int], Episode]()
    for (row, present), *of_row in zip(rows, *lines, strict=True):
        verdicts = [replace(verdict, n=line.n) for verdict, line in zip(row.verdicts, of_row, strict=True)]
        known, changes = follow(known, run.case.spec.gap, present, verdicts, instant=of_row[0].instant)
        found |= {(change.index, change.episode.first): change.episode for change in changes}
    by_time = sorted(found.items(), key=lambda item: (item[1].began, item[1].first))
    return [[episode for (at, _), episode in by_time if at == i] for i in range(len(lines))]


def worst_of(episodes: Iterable[Episode]) -> list[Worst | None]:
    """The worst of those that are over; of one that is open it is told as it was when it last grew by a tenth."""
    return [episode.worst for episode in episodes if not episode.open]


@pytest.mark.parametrize("restarts", [0, 0.15])
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_episodes_are_those_of_the_rows_as_they_stand(time: Time, restarts: float) -> None:
    found, revised, worse = 0, 0, 0
    for number in (*DIFFERED, *range(SEED, SEED + CASES)):
        rng = random.Random(f"episodes {time} {number}")
        spec, events = case(rng, time)
        p, q = spec.properties
        if number % 2 and number not in DIFFERED:  # no formula that is made by chance has bounds
            q = dataclasses.replace(q, formula=parse_formula(rng.choice(BOUNDED), time))
        spec = dataclasses.replace(spec, properties=(p, q), gap=rng.choice((0, SECOND, 4 * SECOND)))
        run = Following(Case(spec, events), divided=rng.random() < 0.5, restarts=restarts)
        run.judge(rng)
        name = f"case {number}, {time}: " + "; ".join(p.text for p in spec.properties)
        rows = list(in_order(run))
        of_each = standing(run, rows)
        for i, (lines, in_place) in enumerate(zip(of_each, followed(run, rows, of_each), strict=True)):
            wanted = sorted(told(expected(lines, spec.gap)), key=lambda episode: (episode.began, episode.first))
            have = [replace(episode, final=False) for episode in told(run.kept.of(i))]
            assert have == wanted, name
            assert worst_of(run.kept.of(i)) == worst_of(in_place), name
            worse += sum(worst is not None for worst in worst_of(run.kept.of(i)))
            found += len(wanted)
        revised += len(run.book.revisions)
    assert found > CASES / 2
    assert revised > CASES / 10
    assert worse
