"""What a session that revises counts, and numbers, goes on over restarts."""

from __future__ import annotations

import os
import random
from collections import Counter

import msgspec
import pytest

from oracle_server.core.events import Event
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Ordering, Property, Spec
from oracle_server.core.verdicts import Judged
from oracle_server.engines.native import NativeEngine
from tests.core.revising import COUNTED, A, B, Run, case
from tests.core.test_revise import BOTH, MS, PAIRED, event, session_of
from tests.engines.test_against_brute import SEED
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "400"))
FOUND = 209894914
"""A case with wrong clocks of which a restart failed: a late step was put before what had been said to be final."""


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_a_session_that_is_restarted_counts_as_one_that_never_was(time: Time) -> None:
    """`Run` holds its counts against what it said, and `Book` the numbers of deadlines."""
    counted = Counter[str]()
    for number in (*range(SEED, SEED + CASES // 3), FOUND):
        rng = random.Random(f"counted {time} {number}")
        drawn = case(rng, time, horizon=rng.choice((2, 4, 60)) * SECOND)
        events = [marred(rng, event) for event in drawn.events]
        run = Run(drawn._replace(events=events), divided=rng.random() < 0.5, restarts=0.4)
        run.suspends = random.Random(number) if number % 2 else None
        run.judge(rng)
        counted += run.book.counts()
        counted["ticks"] += run.book.ticks
    names = [*COUNTED, *(["ticks"] if time == "seconds" else [])]
    assert min(counted[name] for name in names) > CASES / 30, counted


def marred(rng: random.Random, event: Event) -> Event:
    """An event, at times one before which some were lost, or of a clock that is wrong."""
    if rng.random() < 0.1:
        return msgspec.structs.replace(event, lost=rng.randint(1, 3))
    return msgspec.structs.replace(event, stamp=event.arrived + 2 * SECOND) if rng.random() < 0.1 else event


def deadlines_session(rows: list[Judged]) -> Session:
    """A session restored by rows; 1 s after each message on /a its property is violated."""
    text = 'not once[1s:] {topic: "/a"}'
    prop = Property("p", parse_formula(text, "seconds"), text, time="seconds")
    ordering = Ordering(max_delay=100 * MS, late="revise", horizon=60 * SECOND)
    session = Session(plan(Spec("s", BOTH, (prop,), ordering)), [[NativeEngine(prop.formula, "seconds")]], begun=SECOND)
    for position, row in enumerate(rows, 1):
        session.rejudge_row(row, position)
    session.finish_again()
    return session


def test_no_snapshot_is_taken_before_the_deadlines_of_before_a_restart_are_said() -> None:
    """It would be as of before a row that is in no history."""
    session = deadlines_session([])
    rows = session.ingest(event(A, 1, 2_000, 2_000)) + session.ingest(event(B, 1, 4_000, 4_000))
    rows += session.finish(4_000 * MS)
    assert [row.step.event.monitor for row in rows] == ["m", "", "n"]
    again = deadlines_session([rows[0], msgspec.structs.replace(rows[2], verdicts=rows[1].verdicts)])
    before = again.can_be_saved
    (said,) = again.advance(4_100 * MS)
    assert (said.step.event.seq, said.verdicts[0].n) == (1, 3)
    assert (before, again.can_be_saved) == (False, True)
    data = again.snapshot()
    assert data is not None
    assert data["revising"]["position"] == 0


def test_a_snapshot_of_an_older_version_counts_what_it_had_counted() -> None:
    session = session_of(PAIRED)
    rows = session.ingest(event(B, 1, 2_000, 2_000)) + session.advance(2_100 * MS)
    rows += session.ingest(event(A, 1, 1_950, 2_300)) + session.advance(2_310 * MS)
    data = session.snapshot()
    assert data is not None
    del data["revising"]["counted"]
    again = Session(session.plan, [[NativeEngine(p.formula) for p in session.plan.spec.properties]])
    again.restore(data, 1)
    for position, row in enumerate(rows, 1):
        again.rejudge_row(row, position)
    again.finish_again()
    counters = again.judges["publication"].counters
    assert (counters.late, counters.revised, again.counts["m", A].late) == (1, 1, 1)
