"""Sessions that revise, once they are closed: what is final is said to be, live and after a restart."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from dataclasses import replace
from typing import Protocol

import pytest

from oracle_server.core.events import ENDED
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula, Historically, Once
from oracle_server.core.session import Session
from oracle_server.core.verdicts import FINAL, Outcome
from tests.core.revising import A, B, Case, Run, case, compared, in_order, reference
from tests.core.revising_derived import case as derived_case
from tests.core.test_revise import MS, event, session_of, told
from tests.engines.test_against_brute import SEED
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "400")) // 6


class Makes(Protocol):
    """Makes a random case."""

    def __call__(self, rng: random.Random, time: Time) -> Case: ...


def settling(rng: random.Random, found: Case) -> Case:
    """A case whose properties often settle, and no event of which is beyond the horizon."""
    properties, around = [], (Historically, Once, _plain)
    for prop in found.spec.properties:
        formula = rng.choice(around)(prop.formula)
        properties.append(replace(prop, formula=formula, text=render(formula, prop.time)))
    ordering = replace(found.spec.ordering, horizon=rng.choice([20 * SECOND, 60 * SECOND]))
    return found._replace(spec=replace(found.spec, properties=tuple(properties), ordering=ordering))


def _plain(formula: Formula) -> Formula:
    return formula


def outcomes(session: Session) -> Iterator[tuple[Outcome, tuple[bool, bool] | None]]:
    """How each property stands, and whether its episode, if it has one, is open and final."""
    judge = session.judges["publication"]
    episodes = judge.following.episodes or (None,) * len(judge.properties)
    for state, episode in zip(judge.properties, episodes, strict=True):
        yield state.outcome, None if episode is None else (episode.open, episode.final)


@pytest.mark.parametrize("makes", [case, derived_case])
@pytest.mark.parametrize("restarts", [0, 0.15])
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_what_the_order_of_publication_makes_final_is_final_once_closed(
    makes: Makes, time: Time, restarts: float
) -> None:
    ended = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"closed {time} {number}")
        run = Run(settling(rng, makes(rng, time)), divided=rng.random() < 0.5, restarts=restarts)
        run.judge(rng)
        now = run.session.now
        stands = compared(run.stands())
        rows = run.session.end(now)
        run.take(rows)
        said = f"case {number}, {time}: " + "; ".join(p.text for p in run.case.spec.properties)
        again = [[v.outcome for v in row.verdicts] for row, _ in in_order(run)]
        wanted = [next((o for o in each if o in FINAL), None) for each in zip(*again, strict=True)]
        states = list(outcomes(run.session))
        assert [o if o in FINAL else None for o, _ in states] == (wanted or [None] * len(states)), said
        assert all(episode == (True, True) for o, episode in states if o is Outcome.FALSE), said
        for row in rows:
            ended += 1
            assert row.step.event.source == ENDED
            assert [v.outcome for v in row.verdicts] == [o for o, _ in states], said
            assert not any(v.explanation for v in row.verdicts), "no violation begins with it"
        assert stands == compared(reference(run)), said
        if rng.random() < 0.5:
            run.save()
        run.restart(now, [])
        assert list(outcomes(run.session)) == states, said
        assert run.session.finish(now) == run.session.end(now) == [], "it has been said"
    assert ended > CASES / 10


def test_a_session_that_is_closed_says_what_is_final_and_nothing_has_a_place_then() -> None:
    session = session_of('historically not {topic: "/b"}')
    session.ingest(event(B, 1, 2_000, 2_000))
    found = session.advance(2_100 * MS)
    assert told(found) == ["currently_false"]
    assert session.finish(2_200 * MS) == []
    (row,) = session.end(2_200 * MS)
    assert told([row]) == ["false"]
    assert (row.step.event.source, row.step.stamp, row.verdicts[0].n) == (ENDED, 2_000 * MS, 2)
    assert session.judges["publication"].properties[0].outcome is Outcome.FALSE
    assert session.judges["publication"].properties[0].violations == 1
    (episode,) = session.judges["publication"].following.episodes
    assert episode is not None
    assert (episode.first, episode.last, episode.final, episode.count) == (1, 2, True, 1)
    session.ingest(event(A, 1, 1_990, 2_300))  # as where the closing has failed
    late = session.finish(2_400 * MS)
    assert told(late) == ["false"]
    assert [(row.place, row.verdicts[0].degraded) for row in late] == [(None, True)]
    assert session.end(2_400 * MS) == []


def test_a_session_that_is_closed_says_nothing_where_nothing_is_final() -> None:
    session = session_of('not {topic: "/b"}')
    session.ingest(event(B, 1, 2_000, 2_000))
    session.finish(2_200 * MS)
    assert session.end(2_200 * MS) == []
