"""Properties that oracles elsewhere judge, without any oracle: what waits, what leaves, and in which order."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

from oracle_server.core.asking import Ask
from oracle_server.core.engine import Answer
from oracle_server.core.session import Session
from oracle_server.core.spec import SILENT, External, Property, StreamSpec
from oracle_server.core.verdicts import Judged, Outcome, explain, record
from oracle_server.engines.table import make_engine
from tests.core.sessions import A, B, Feed, U, degraded, open_session, outcomes, prop
from tests.engines.test_against_brute import SEED

URL = "ws://oracle:1"
YES, NO = (Answer(o, f'said "{o.value}"') for o in (Outcome.CURRENTLY_TRUE, Outcome.CURRENTLY_FALSE))
NOTHING = Answer(Outcome.UNKNOWN, "did not answer within 1 s")
STREAMS = [StreamSpec("/a", action="filter"), StreamSpec("/b"), StreamSpec("/u", ordered=False)]


def external(name: str = "p", *streams: str, **more: Any) -> Property:
    oracle = External(URL, streams=frozenset(streams) or None)
    return Property(name, SILENT, f"the oracle at {URL}", engine="external", external=oracle, **more)


def session_of(*properties: Property, **ordering: Any) -> Session:
    return open_session(
        properties, attach={"m": [A, B, U]}, streams=STREAMS, maker=make_engine, **{"by": "arrival", **ordering}
    )


def seqs(judged: list[Judged]) -> list[int]:
    return [j.step.event.seq for j in judged]


def test_a_step_waits_for_its_answer_and_what_is_behind_waits_too() -> None:
    session = session_of(external("p", "/a"), prop("q", 'not {topic: "/b"}'))
    feed = Feed(session)
    assert feed(A, 10) == []
    assert feed(B, 11) == []
    (ask,) = session.take_asks()
    assert (ask.step.event.stream, ask.time, session.take_asks()) == (A, 10, [])
    judged = session.resolve(ask, YES, 30)
    assert seqs(judged) == [1, 2]
    assert [j.judged for j in judged] == [30, 30]
    assert outcomes(judged, "q") == ["currently_true", "currently_false"]
    assert [v.n for j in judged for v in j.verdicts] == [1, 2, 3, 4]


def test_answers_out_of_order_are_judged_in_order() -> None:
    session = session_of(external("p"), external("q"))
    feed = Feed(session)
    feed(A, 10)
    feed(A, 11)
    first, second, third, fourth = session.take_asks()
    assert session.resolve(fourth, NO, 20) == []
    assert session.resolve(third, NO, 21) == []
    assert session.resolve(second, YES, 22) == []
    judged = session.resolve(first, YES, 23)
    assert (outcomes(judged, "p"), outcomes(judged, "q")) == (["currently_true", "currently_false"],) * 2


def test_what_an_oracle_says_decides() -> None:
    session = session_of(external(guards=frozenset({"/a"})))
    feed = Feed(session)
    choices = []
    for n, answer in enumerate((YES, NO, NOTHING, YES), 1):
        feed(A, n, ask=True)
        (judged,) = session.resolve(session.take_asks()[0], answer, n)
        assert judged.decision
        choices.append(judged.decision.choice)
    assert choices == ["allow", "deny", "deny", "allow"]


def test_a_violation_says_whose_word_it_is() -> None:
    session = session_of(external())
    Feed(session)(A, 10)
    (judged,) = session.resolve(session.take_asks()[0], NO, 11)
    why = explain(judged, judged.verdicts[0])
    assert why
    said = f'the oracle at {URL}: said "currently_false"'
    assert why["text"] == f"p does not hold at step 1 (0.000 s), /a (topic 1 of m): {said}"
    assert why["formula"] == f"the oracle at {URL}"


def test_what_is_unknown_is_told_and_degrades_what_follows() -> None:
    session = session_of(external())
    feed, judged = Feed(session), []
    for n, answer in enumerate((YES, NOTHING, YES, NOTHING), 1):
        feed(A, n)
        judged += session.resolve(session.take_asks()[0], answer, n)
    assert outcomes(judged) == ["currently_true", "unknown", "currently_true", "unknown"]
    assert degraded(judged) == [False, False, True, True]
    (state,) = session.judges["arrival"].properties
    assert state.failures == 2
    assert state.complaint == (
        f"the oracle at {URL} left steps unknown 2 times; the last time it did not answer within 1 s"
    )


def test_an_oracle_that_may_have_begun_anew_degrades_what_it_says() -> None:
    session = session_of(external())
    feed, judged = Feed(session), []
    for n, answer in enumerate((YES, YES._replace(anew=True), YES), 1):
        feed(A, n)
        judged += session.resolve(session.take_asks()[0], answer, n)
    assert degraded(judged) == [False, True, True]


def test_at_what_an_oracle_does_not_hear_its_last_word_stands() -> None:
    session = session_of(external("p", "/a"))
    feed = Feed(session)
    judged = feed(B, 1)
    feed(A, 2)
    judged += session.resolve(session.take_asks()[0], NO, 2) + feed(B, 3)
    feed(A, 4)
    judged += session.resolve(session.take_asks()[0], YES, 4) + feed(B, 5)
    assert outcomes(judged) == [
        "unknown", "currently_false", "currently_false", "currently_true", "currently_true",
    ]  # fmt: skip
    assert not any(degraded(judged)), "nothing was left unknown that it heard"


def test_a_latched_property_is_asked_about_no_more() -> None:
    session = session_of(external(latch=True))
    feed = Feed(session)
    feed(A, 1)
    judged = session.resolve(session.take_asks()[0], NO, 1) + feed(A, 2)
    assert session.take_asks() == []
    assert outcomes(judged) == ["false", "false"]


def test_what_is_skipped_is_not_asked_about_and_keeps_its_place() -> None:
    session = session_of(external(), by="publication", late="skip")
    feed = Feed(session)
    feed(A, 20)
    assert session.advance(100) == []
    assert feed(B, 10, arrived=100) == []
    (ask,) = session.take_asks()
    judged = session.resolve(ask, YES, 101)
    assert [(j.step.event.seq, j.step.skipped) for j in judged] == [(1, False), (2, True)]
    assert outcomes(judged) == ["currently_true", "unknown"]


def test_while_nothing_can_be_kept_nothing_is_judged_whatever_the_oracle_says() -> None:
    session = session_of(external(guards=frozenset({"/a"})))
    feed = Feed(session)
    feed(A, 1)
    session.suspended = True
    judged = session.resolve(session.take_asks()[0], YES, 2) + feed(A, 3)
    session.suspended = False
    assert session.take_asks() == []
    assert outcomes(judged) == ["unknown", "unknown"]


def test_an_event_that_came_while_nothing_could_be_kept_is_never_given_anothers_answer() -> None:
    session = session_of(external())
    feed = Feed(session)
    feed(A, 1)
    session.suspended = True
    feed(A, 2)
    session.suspended = False
    (ask,) = session.take_asks()
    assert outcomes(session.resolve(ask, YES, 3)) == ["currently_true", "unknown"]


def test_what_is_given_up_is_unknown_and_a_late_answer_changes_nothing() -> None:
    session = session_of(external())
    feed = Feed(session)
    feed(A, 1)
    feed(A, 2)
    first, second = session.take_asks()
    judged = session.resolve(first, YES, 2) + session.abandon("had not answered when the session ended", 3)
    assert outcomes(judged) == ["currently_true", "unknown"]
    assert session.resolve(second, YES, 4) == []
    assert not session.asking


def test_an_answer_counts_once() -> None:
    session = session_of(external("p"), external("q"))
    Feed(session)(A, 1)
    first, second = session.take_asks()
    assert session.resolve(first, NO, 1) + session.resolve(first, YES, 1) == []
    (judged,) = session.resolve(second, YES, 1)
    assert outcomes([judged], "p") == ["currently_false"]


def test_times_that_oracles_are_told_never_go_back() -> None:
    session = session_of(external(), by="publication")
    feed = Feed(session)
    for stream, stamp, arrived in ((A, 20, 20), (B, 25, 25), (A, 5, 30), (U, 90, 31), (B, 40, 40)):
        feed(stream, stamp, arrived=arrived)
    session.finish(60)
    assert [ask.time for ask in session.take_asks()] == [20, 20, 20, 25, 40]


# Whenever the answers come, the records are the same


def says(ask: Ask) -> Answer:
    """An oracle without a memory."""
    value = ask.step.signals["v"]
    return NOTHING if value == 3 else NO if ask.property == 0 and value == 4 else YES


def told(judged: list[Judged]) -> list[dict[str, Any]]:
    """The records without when they were made; a tick arrives when it is judged."""
    late = {"judged": 0, "arrived": 0}
    ticks = [j.step.event.stream.kind == "tick" for j in judged]
    return [
        record(j, verdict) | (late if tick else {"judged": 0})
        for j, tick in zip(judged, ticks, strict=True)
        for verdict in j.verdicts
    ]


def run(seed: int, by: str, resolve: Callable[[random.Random, Session, list[Ask]], list[Judged]]) -> list[Judged]:
    """A session of random events, late, unordered and asked about, with deadlines; `resolve` answers what is asked."""
    dice, answering = random.Random(seed), random.Random(seed + 1)
    session = session_of(
        external("p"), prop("late", 'once[10ns:] {topic: "/a"} -> once[:20ns] {topic: "/b"}', time="seconds"),
        external("q", "/b"), prop("v", "historically not {v: 5}", guards=frozenset({"/a"})),
        by=by, max_delay=8, late=dice.choice(["judge", "skip"]),
    )  # fmt: skip
    feed, judged, now, open_ones = Feed(session), [], 1, list[Ask]()
    for _ in range(60):
        now += dice.choice([0, 1, 1, 3, 12])
        stream, stamp = dice.choice([A, B, U]), max(1, now - dice.choice([0, 1, 4, 9, 15]))
        value, asking = dice.randint(1, 5), dice.random() < 0.3
        if dice.random() < 0.2:
            judged += session.advance(now)
        judged += feed(stream, stamp, {"v": value}, arrived=now, ask=asking and stream == A)
        open_ones += session.take_asks()
        judged += resolve(answering, session, open_ones)
    judged += session.finish(now)
    open_ones += session.take_asks()
    while open_ones:
        judged += resolve(answering, session, open_ones)
    return judged + session.advance(now + 100)


def at_once(dice: random.Random, session: Session, asks: list[Ask]) -> list[Judged]:
    judged = [j for ask in asks for j in session.resolve(ask, says(ask), session.now)]
    asks.clear()
    return judged


def some_day(dice: random.Random, session: Session, asks: list[Ask]) -> list[Judged]:
    judged = []
    for _ in range(dice.choice([0, 0, 1, 2, 6])):
        if asks:
            ask = asks.pop(dice.randrange(len(asks)))
            judged += session.resolve(ask, says(ask), session.now)
    return judged


@pytest.mark.parametrize("by", ["publication", "arrival", "both"])
@pytest.mark.parametrize("number", range(5))
def test_the_records_do_not_depend_on_when_the_answers_come(number: int, by: str) -> None:
    judged, late = run(SEED + number, by, at_once), run(SEED + number, by, some_day)
    assert told(late) == told(judged), f"TEST_SEED={SEED}"
