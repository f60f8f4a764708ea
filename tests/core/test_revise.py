"""What stands of a session that revises is what judging its events in the order of publication gives."""

from __future__ import annotations

import os
import random
from dataclasses import replace
from typing import Any

import pytest

from oracle_server.core.atoms import Matches
from oracle_server.core.events import Event
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.plan import plan
from oracle_server.core.revise.judge import FEW
from oracle_server.core.revise.kept import Keeping
from oracle_server.core.revise.lateness import TOGETHER
from oracle_server.core.revise.saving import SavableJudge
from oracle_server.core.revisions import Revision
from oracle_server.core.session import Session
from oracle_server.core.spec import Ordering, Property, Spec, StreamSpec
from oracle_server.core.verdicts import Judged, Outcome, explain
from oracle_server.engines.native import NativeEngine
from tests.core.revising import A, B, Run, U, case, compared, reference
from tests.engines.test_against_brute import SEED
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "750"))
FOUND = (1145, 2244, 2971, 26876)
"""Cases that earlier versions got wrong: restarts, steps without order, and passes that deadlines waited for."""
MS = SECOND // 1000


@pytest.mark.parametrize("restarts", [0, 0.15])
@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_what_stands_is_what_the_order_of_publication_gives(time: Time, restarts: float) -> None:
    revised = 0
    for number in (*range(SEED, SEED + CASES), *FOUND):
        rng = random.Random(f"revise {time} {number}")
        run = Run(case(rng, time), divided=rng.random() < 0.5, restarts=restarts)
        run.judge(rng)
        told = f"case {number}, {time}: " + "; ".join(p.text for p in run.case.spec.properties)
        assert compared(run.stands()) == compared(reference(run)), told
        revised += len(run.book.revisions)
    assert revised > CASES / 10


BOTH = (StreamSpec("/a"), StreamSpec("/b"))


def session_of(formula: str, streams: tuple[StreamSpec, ...] = BOTH) -> Session:
    ordering = Ordering(max_delay=100 * MS, late="revise", horizon=SECOND)
    prop = Property("p", parse_formula(formula, "steps"), formula, guards=frozenset({"/b"}))
    session = Session(plan(Spec("s", streams, (prop,), ordering)), [[NativeEngine(prop.formula)]])
    for monitor in "mn":
        session.attach(monitor, [A] if monitor == "m" else [B], SECOND)
    return session


def event(key: Any, seq: int, at: int, arrived: int, *, ask: bool = False, **data: Any) -> Event:
    """An event of /a by m or of /b by n; times in milliseconds."""
    return Event(key, "m" if key == A else "n", seq, at * MS, arrived * MS, data, ask=ask)


def told(judged: list[Judged]) -> list[str]:
    return [row.verdicts[0].outcome.value for row in judged if not isinstance(row, Revision)]


PAIRED = 'not {topic: "/b"} or once {topic: "/a"}'
"""Before each message on /b there was one on /a."""


def test_a_late_event_takes_back_a_violation_and_says_why() -> None:
    session = session_of(PAIRED)
    assert session.ingest(event(B, 1, 2_000, 2_000)) == []
    (row,) = session.advance(2_100 * MS)
    assert told([row]) == ["currently_false"]
    assert row.step.released == "max_delay"
    assert row.step.unheard == {"/a"}
    assert session.ingest(event(A, 1, 1_950, 2_300)) == []
    assert session.next_deadline == 2_300 * MS + TOGETHER, "others may come with it"
    late, revision = session.advance(2_310 * MS)
    assert (late.number, late.place, late.step.late) == (2, 1, True)
    assert isinstance(revision, Revision)
    (change,) = revision.changes
    assert change is not None
    assert (change.first, change.last, change.outcome, change.retracted) == (1, 1, "currently_true", True)
    assert [(e.monitor, e.seq) for e in revision.because] == [("m", 1)]
    assert session.judges["publication"].properties[0].violations == 0


def test_events_that_come_late_together_cost_one_pass() -> None:
    session = session_of(PAIRED)
    for seq in range(1, 101):
        session.ingest(event(B, seq, 2_000 + seq, 2_000 + seq))
    session.advance(2_400 * MS)
    for seq in range(1, 101):
        assert session.ingest(event(A, seq, 1_900 + seq, 2_400)) == []
    judged = session.advance(2_420 * MS)
    assert session.lateness is not None
    assert (session.lateness.placed, session.lateness.passes) == (100, 1)
    (revision,) = [row for row in judged if isinstance(row, Revision)]
    assert (len(revision.because), revision.causes) == (10, 100)
    (change,) = revision.changes
    assert change is not None
    assert (change.first, change.last) == (1, 100), "one record for a run of verdicts with the same change"


def test_a_late_event_that_asks_is_decided_at_once() -> None:
    streams = (StreamSpec("/a"), StreamSpec("/b", action="filter"))
    session = session_of(PAIRED, streams)
    session.ingest(event(A, 1, 2_000, 2_000))
    assert session.advance(2_100 * MS) != []
    (asked,) = session.ingest(event(B, 1, 1_900, 2_200, ask=True))
    assert asked.decision is not None
    assert asked.decision.choice == "deny", "nothing on /a was published before it"


def test_a_decision_stays_as_it_was_and_the_record_says_what_it_would_have_been() -> None:
    streams = (StreamSpec("/a"), StreamSpec("/b", action="filter"))
    session = session_of(PAIRED, streams)
    session.ingest(event(B, 1, 2_000, 2_000, ask=True))
    (denied,) = session.advance(2_100 * MS)
    assert denied.decision is not None
    assert denied.decision.choice == "deny"
    session.ingest(event(A, 1, 1_950, 2_300))
    revision = session.advance(2_310 * MS)[-1]
    assert isinstance(revision, Revision)
    (change,) = revision.changes
    assert change is not None
    assert change.decision == "allow"


def test_what_is_beyond_the_horizon_is_judged_now_and_all_is_degraded_from_then_on() -> None:
    session = session_of(PAIRED)
    session.ingest(event(B, 1, 4_000, 4_000))
    session.advance(4_100 * MS)
    session.ingest(event(A, 1, 2_999, 4_200))
    (late,) = session.advance(4_210 * MS)
    assert (late.place, late.step.late, late.verdicts[0].degraded) == (None, True, True)
    session.ingest(event(A, 2, 3_000, 4_300))
    (placed, _) = session.advance(4_310 * MS)
    assert placed.place == 1, "at the horizon exactly there is a place"


def test_a_final_outcome_is_said_once_no_late_event_can_change_it() -> None:
    session = session_of('historically not {topic: "/b"}')
    session.ingest(event(B, 1, 2_000, 2_000))
    found = told(session.advance(2_100 * MS))
    for seq, at in enumerate((2_500, 3_000, 3_001), 1):
        found += told(session.ingest(event(A, seq, at, at)))
    found += told(session.advance(3_500 * MS))
    assert found == ["currently_false", "currently_false", "currently_false", "false"]


def test_no_more_steps_are_kept_than_the_bound_and_the_horizon_is_shorter_then() -> None:
    session = session_of(PAIRED)
    assert session.lateness is not None
    judge = session.lateness.judge
    judge.keeping = Keeping(judge.horizon, judge.keeping.base, most=10)
    for seq in range(1, 31):
        session.ingest(event(B, seq, 2_000 + seq, 2_000 + seq))
    session.advance(2_200 * MS)
    assert (len(judge.keeping), judge.keeping.crowded) == (10, True)
    session.ingest(event(A, 1, 2_015, 2_300))
    session.ingest(event(A, 2, 2_025, 2_300))
    session.advance(2_310 * MS)
    assert (session.lateness.placed, session.lateness.beyond) == (1, 1)


def test_what_is_held_and_late_is_judged_in_turns_where_a_session_is_closed() -> None:
    session = session_of(PAIRED)
    session.divide(lambda: True)
    for seq in range(1, 11):
        session.ingest(event(B, seq, 2_000 + seq, 2_000 + seq))
    while (due := session.next_deadline) is not None and due <= 2_200 * MS:
        session.advance(2_200 * MS)
    session.ingest(event(A, 1, 1_999, 2_300))
    session.advance(2_300 * MS)
    turns, found = 0, list[Judged]()
    while session.has_due or session.release():
        turns, found = turns + 1, [*found, *session.advance(2_300 * MS)]
    assert turns > 10
    assert [isinstance(row, Revision) for row in found] == [False, True]
    assert session.finish(2_300 * MS) == []


def test_why_the_order_released_an_event() -> None:
    session = session_of(PAIRED)
    session.ingest(event(B, 1, 2_000, 2_000))
    by_frontier = session.ingest(event(A, 1, 2_000, 2_010))
    assert [row.step.released for row in by_frontier] == ["frontier", "frontier"]
    session.ingest(event(B, 2, 2_020, 2_020))
    by_clock = session.clock("m", [ClockReading(A, 2_030 * MS)], 2_040 * MS)
    assert [row.step.released for row in by_clock] == ["clock"]
    session.ingest(event(B, 3, 2_050, 2_050))
    assert [row.step.released for row in session.advance(2_150 * MS)] == ["max_delay"]


def test_specs_that_do_not_revise_have_no_part_in_it() -> None:
    session = session_of(PAIRED)
    plain = replace(session.plan.spec, ordering=replace(session.plan.spec.ordering, late="judge"))
    (prop,) = plain.properties
    assert Session(plan(plain), [[NativeEngine(prop.formula)]]).lateness is None


class Counting(NativeEngine):
    """Counts its steps."""

    count = 0

    def step(self, time: int, matches: Matches) -> Outcome:
        self.count += 1
        return super().step(time, matches)


def test_to_restore_what_came_late_judges_each_step_about_once_and_not_as_often_as_it_was() -> None:
    session, rows = session_of(PAIRED), list[Judged]()
    for seq in range(1, 401):
        rows += session.ingest(event(B, seq, 2_000 + 2 * seq, 2_000 + 2 * seq))
        rows += session.ingest(event(A, seq, 1_850 + 2 * seq, 2_001 + 2 * seq))
        rows += session.advance((2_001 + 2 * seq) * MS)
    rows += session.finish(5_000 * MS)
    assert session.lateness is not None
    assert session.lateness.passes > 50
    (prop,) = session.plan.spec.properties
    engine = Counting(prop.formula)
    again = Session(session.plan, [[engine]], begun=SECOND)
    for position, row in enumerate(rows, 1):
        again.rejudge_row(row, position)
    again.finish_again()
    assert engine.count < 2 * len(rows)
    assert again.lateness is not None
    one, other = session.lateness.judge.keeping, again.lateness.judge.keeping
    assert {r.position: r.judged.verdicts[0].outcome for r in other} == {
        r.position: r.judged.verdicts[0].outcome for r in one
    }


WAITING = 'not (once[1s:60s] ({topic: "/a"} and pre {topic: "/b"}) and {never: true})'
"""It has a deadline 1 s after each message on /a, and none changes it."""


def timed_session() -> Session:
    ordering = Ordering(max_delay=100 * MS, late="revise", horizon=SECOND)
    prop = Property("p", parse_formula(WAITING, "seconds"), WAITING, time="seconds")
    streams = (StreamSpec("/a"), StreamSpec("/u", ordered=False))
    session = Session(plan(Spec("s", streams, (prop,), ordering)), [[NativeEngine(prop.formula, "seconds")]])
    session.attach("m", [A, U], SECOND)
    return session


def told_by_a(session: Session, until: int) -> list[Judged]:
    """The clock of /a (ms), which judges all that is older."""
    return session.clock("m", [ClockReading(A, until * MS)], until * MS)


def test_a_step_without_order_stands_behind_what_was_told_before_it() -> None:
    session, rows = timed_session(), list[Judged]()
    rows += session.ingest(event(A, 1, 2_000, 2_000))
    rows += told_by_a(session, 3_050)
    rows += session.ingest(Event(U, "m", 2, 3_050 * MS, 3_050 * MS, {}))
    assert len(rows) == 2, "the deadline changed nothing"
    again = Session(session.plan, [[NativeEngine(p.formula, "seconds") for p in session.plan.spec.properties]])
    for position, row in enumerate(rows, 1):
        again.rejudge_row(row, position)
    again.finish_again()
    found = []
    for each in (session, again):
        assert each.lateness is not None
        found.append([(row.key, row.level) for row in each.lateness.judge.keeping])
    assert found[0] == found[1]
    late = session.ingest(event(A, 3, 2_900, 3_060)) + told_by_a(session, 3_100)
    assert [row.step.late for row in late] == [False], "nothing that was told is younger"


def test_what_is_kept_has_no_messages() -> None:
    session = session_of(PAIRED)
    judged = session.ingest(event(A, 1, 2_000, 2_000, scan=[0.0] * 1_000)) + session.advance(2_200 * MS)
    assert session.lateness is not None
    assert (
        [row.step.event.seq for row in session.lateness.judge.keeping] == [row.step.event.seq for row in judged] == [1]
    )
    assert judged[0].step.event.data is None, "its signals are computed, and a horizon may have 10,000 of them"


def test_few_deadlines_are_judged_again_with_each_step_without_order(monkeypatch: pytest.MonkeyPatch) -> None:
    session, ticks = timed_session(), list[int]()
    for seq in range(1, 201):
        session.ingest(event(A, seq, 2_000 + seq, 2_000 + seq))
    told_by_a(session, 5_000)
    tick = SavableJudge.tick

    def counted(self: SavableJudge, time: int, *rest: Any) -> Judged | None:
        ticks.append(time)
        return tick(self, time, *rest)

    monkeypatch.setattr(SavableJudge, "tick", counted)
    for seq in range(1, 31):
        at = (5_000 + 10 * seq) * MS
        session.ingest(Event(U, "m", 200 + seq, at, at, {}))
        session.advance(at)
    assert len(ticks) < 30 * (FEW + 2) + 200


def test_an_explanation_names_steps_by_their_numbers_and_windows_by_places() -> None:
    session = session_of('not {topic: "/b"} or not once[1:] {topic: "/a", bad: true}')
    for seq in range(1, 4):
        session.ingest(event(B, seq, 2_000 + 10 * seq, 2_000 + 10 * seq))
    session.advance(2_200 * MS)
    session.ingest(event(A, 1, 1_990, 2_210, bad=False))
    session.ingest(event(A, 2, 2_015, 2_210, bad=True))
    revision = session.advance(2_300 * MS)[-1]
    assert isinstance(revision, Revision)
    (change,) = revision.changes
    assert change is not None
    assert change.explanation is not None
    assert "at step 2 (2.020 s)" in change.explanation["text"]
    assert "held at step 5 (2.015 s)" in change.explanation["text"], "the number of its record"
    (_, why) = change.explanation["reasons"]
    assert why["event"] is not None
    assert (why["at"], why["event"]["step"]) == (3, 5)


def test_an_explanation_counts_a_window_in_places_where_late_events_were_put_in_theirs() -> None:
    def revised(formula: str) -> tuple[list[Judged], Session]:
        session = session_of(formula)
        for seq in range(1, 6):
            session.ingest(event(B, seq, 2_000 + 10 * seq, 2_000 + 10 * seq, n=seq))
        return session.advance(2_200 * MS), session

    judged, _ = revised('not {n: 4} or once[1:2] {topic: "/a"}')
    assert "none in steps 2–3" in str([explain(row, row.verdicts[0]) for row in judged])  # noqa: RUF001
    judged, session = revised("not {n: 4} or once[2:3] {n: 1}")
    assert not any(row.verdicts[0].explanation for row in judged)
    session.ingest(event(A, 1, 2_035, 2_210))
    (_, revision) = session.advance(2_300 * MS)
    assert isinstance(revision, Revision)
    (change,) = revision.changes
    assert change is not None
    assert change.explanation is not None
    assert "at step 4 (2.040 s)" in change.explanation["text"]
    assert "none in places 2–3" in change.explanation["text"]  # noqa: RUF001


def test_no_more_steps_are_remembered_than_explanations_and_kept_rows_need() -> None:
    session = session_of(PAIRED)
    assert session.lateness is not None
    judge = session.lateness.judge
    judge.remember(10, 1_000)
    for seq in range(1, 401):
        session.ingest(event(A, seq, 2_000 + 10 * seq, 2_000 + 10 * seq))
    session.advance(6_100 * MS)
    remembered = [place for place, *_ in judge._recent._steps]
    assert len(remembered) <= 10 + 100 + 2 * 64, "a horizon has 100 steps, and rows are forgotten 64 at once"
