"""What stands with derived signals is what judging the events in the order of publication gives."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from typing import Any

import pytest

from oracle_server.core.derived.definition import Definition
from oracle_server.core.events import Step
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.plan import plan
from oracle_server.core.revise import judge, recurring
from oracle_server.core.revise.kept import Keeping
from oracle_server.core.revise.queued import Asked
from oracle_server.core.revise.recurring import Recurring, Row
from oracle_server.core.revisions import Revision
from oracle_server.core.session import Session
from oracle_server.core.spec import Ordering, Property, Spec, StreamSpec
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.engines.native import NativeEngine
from tests.core.revising import A, B, Run, compared, reference
from tests.core.revising_derived import case
from tests.core.test_revise import MS, event
from tests.core.test_revise_restarts import marred
from tests.engines.test_against_brute import SEED
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "400"))
FOUND = (448, 2920)
"""Cases that earlier versions got wrong: steps without order between deadlines that changed nothing, or of one time."""


@pytest.mark.parametrize("restarts", [0, 0.15])
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_what_stands_is_what_the_order_of_publication_gives(time: Time, restarts: float) -> None:
    revised = 0
    for number in (*range(SEED, SEED + CASES), *FOUND):
        rng = random.Random(f"derived {time} {number}")
        run = Run(case(rng, time), divided=rng.random() < 0.5, restarts=restarts)
        run.stops = random.Random(number) if restarts else None
        run.judge(rng)
        told = f"case {number}, {time}: " + "; ".join(p.text for p in run.case.spec.properties)
        assert compared(run.stands()) == compared(reference(run)), told
        revised += len(run.book.revisions)
    assert revised > CASES / 10


def test_many_deadlines_that_had_waited_stand_before_a_step_without_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judge, "FEW", 0)
    for number in range(SEED, SEED + CASES // 5):
        rng = random.Random(f"many {number}")
        run = Run(case(rng, "seconds"), divided=rng.random() < 0.5, restarts=0.2)
        run.judge(rng)
        assert compared(run.stands()) == compared(reference(run)), number


@pytest.mark.parametrize("restarts", [0, 0.15])
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_a_trace_judged_again_says_what_the_session_did_number_for_number(time: Time, restarts: float) -> None:
    for number in range(
        100
    ):  # of 10,000 traces one has a deadline that is judged earlier, when less was known to be lost
        rng = random.Random(f"trace {time} {number}")
        drawn = case(rng, time)
        events = [marred(rng, event) for event in drawn.events] if number % 2 else drawn.events
        run = Run(drawn._replace(events=events), divided=rng.random() < 0.5, restarts=restarts)
        run.judge(rng)
        run.take(run.session.end(run.session.now))
        again = Run(run.case)
        assert again.session.lateness is not None
        rows = Recurring(again.session.lateness.judge)
        for position, row in run.book.first.items():
            again.session.note_again(row.step, row.judged)
            degraded = all(verdict.degraded for verdict in row.verdicts)
            again.book.take(rows.take(Row(position, row.step, row.judged, row.place is not None, degraded)))
        again.book.take(rows.finish())
        assert compared(again.stands()) == compared(run.stands()), number
        for at, row in run.book.rows.items():
            assert told(again.book.rows[at]) == told(row), (number, at)
        assert [*how_it_ended(again)] == [*how_it_ended(run)], number


def test_a_trace_without_revisions_is_judged_as_it_comes_and_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recurring, "MOST", 3)
    rng = random.Random(1)
    run = Run(case(rng, "steps"))
    assert run.session.lateness is not None
    rows = Recurring(run.session.lateness.judge)
    said = []
    for position in range(1, 9):
        step = event(B, position, 2_000 + position, 3_000 + position)
        late = position == 2
        at = Step(step, {}, frozenset(), (1_000 if late else 2_000 + position) * MS, late=late)
        said.append(len(rows.take(Row(position, at, (3_000 + position) * MS, late))))
    assert said[:4] == [1, 0, 0, 0], "they wait for the end of the pass"
    assert said[4] >= 4, "it ends here"
    assert said[5:] == [1, 1, 1]


def told(row: Judged) -> Any:
    """What records tell of a row, but when it was judged; of a revision that it is one."""
    if isinstance(row, Revision):
        return row.first
    event = row.step.event
    arrived = event.arrived if event.monitor else None
    said = [(v.n, v.outcome, v.degraded) for v in row.verdicts]
    return event.stream, event.monitor, event.seq, row.step.stamp, arrived, row.number, row.place, said


def how_it_ended(run: Run) -> Iterator[Outcome]:
    return (state.outcome for state in run.session.judges["publication"].properties)


def test_each_deadline_of_one_time_is_explained_by_itself() -> None:
    asked = 0
    twice = 369875452  # a deadline of a time is judged before an unordered step, and another one after it
    for number in (*range(SEED, SEED + 200), twice):
        rng = random.Random(f"explained {number}")
        run = Run(case(rng, "seconds"))
        run.judge(rng)
        times = [row.step.stamp for row in run.book.first.values() if not row.step.event.monitor]
        for position, row in run.book.first.items():
            if row.step.event.monitor or times.count(row.step.stamp) == 1 or None in run.book.stands(position).outcomes:
                continue
            again = run.fresh()
            assert again.lateness is not None
            again.lateness.judge.asked = Asked(position, 0, row.step.stamp)
            for at in range(1, len(run.book.rows) + 1):
                again.rejudge_row(run.book.rows[at], at)
            again.finish_again()
            answer = again.lateness.judge.answer
            assert answer is not None
            assert answer.verdicts[0].outcome is run.book.stands(position).outcomes[0], number
            asked += 1
    assert asked


def session_of(formula: str, definition: Definition) -> Session:
    """A session over /a by m and /b by n, that revises."""
    prop = Property("p", parse_formula(formula, "seconds"), formula, time="seconds")
    ordering = Ordering(max_delay=100 * MS, late="revise", horizon=SECOND)
    streams = (StreamSpec("/a", signals={"k": "msg.k"}), StreamSpec("/b"))
    spec = Spec("s", streams, (prop,), ordering, derive=(definition,))
    session = Session(plan(spec), [[NativeEngine(prop.formula, "seconds")]])
    for monitor in "mn":
        session.attach(monitor, [A] if monitor == "m" else [B], SECOND)
    return session


def test_an_explanation_names_the_step_of_the_last_sample_by_its_number() -> None:
    count = Definition("n", "count", "", parse_formula("{topic: /a}"), over=10 * SECOND)
    session = session_of("not {topic: /b} or {n < 2}", count)
    session.ingest(event(B, 1, 2_000, 2_000))
    session.advance(2_200 * MS)
    session.ingest(event(A, 1, 1_950, 2_300))
    session.ingest(event(A, 2, 1_960, 2_300))
    revision = session.advance(2_310 * MS)[-1]
    assert isinstance(revision, Revision)
    (change,) = revision.changes
    assert change is not None
    assert change.explanation is not None
    assert "last at step 3" in change.explanation["text"], "its place is 2"


def test_deadlines_of_one_time_are_kept_together_or_not_at_all() -> None:
    count = Definition("n", "count", "", parse_formula("{k: *}"), over=SECOND, by=("k",))
    session = session_of("not {n: 0, k: u}", count)
    assert session.lateness is not None
    own = session.lateness.judge
    own.keeping = Keeping(own.horizon, own.keeping.base, most=4)
    for seq, key in enumerate("uv", 1):
        session.ingest(event(A, seq, 2_000, 2_000, k=key))
    session.advance(3_200 * MS)
    times = [row.step.stamp // MS for row in own.keeping]
    assert times == [2_000, 2_000, 3_000, 3_000], "it is violated for u, and not for v"
    for seq in range(1, 4):
        session.ingest(event(B, seq, 3_500, 3_500))
    session.advance(3_700 * MS)
    assert [row.step.stamp // MS for row in own.keeping] == [3_500] * 3
    assert own.keeping.crowded
