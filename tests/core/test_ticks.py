"""Deadlines that run out between events; a unit of time is a nanosecond."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

from oracle_server.core.events import StreamKey
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Bound, Formula, Historically, Once, Since
from oracle_server.core.session import Session
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import NEGATIVE, Judged, record
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals, truths
from tests.core.sessions import MODE, STREAMS, A, B, Feed, U, open_session, prop
from tests.engines.test_against_brute import SEED
from tests.strategies import SECOND


def native(property_: Property) -> NativeEngine:
    return NativeEngine(property_.formula, property_.time)


def timed(formula: str, **more: Any) -> Property:
    return prop("p", formula, time="seconds", **more)


def session_of(*properties: Property, **ordering: Any) -> Session:
    return open_session(list(properties), attach={"m": [A, B, MODE]}, maker=native, **{"by": "arrival", **ordering})


def told(judged: list[Judged]) -> list[tuple[str, int, str]]:
    return [(j.step.event.stream.kind, j.step.stamp, j.verdicts[0].outcome.value) for j in judged]


ANSWERED = 'once[5ns:] {topic: "/a"} -> once {topic: "/b"}'
"""By 5 ns after the first message on /a there has been one on /b."""


def test_a_deadline_is_judged_when_it_runs_out_and_recorded_once() -> None:
    session = session_of(timed(ANSWERED))
    feed = Feed(session)
    assert told(feed(A, 10)) == [("topic", 10, "currently_true")]
    assert session.next_deadline == 16
    assert session.advance(15) == []
    (tick,) = session.advance(40)
    assert told([tick]) == [("tick", 15, "currently_false")]
    row = record(tick, tick.verdicts[0])
    assert (row["step"], row["kind"], row["violation"], row["judged"]) == (None, "tick", True, 40)
    assert row["explanation"] is not None
    assert "when a deadline ran out" in row["explanation"]["text"]
    assert session.advance(45) == []
    again = feed(MODE, 50)
    assert told(again) == [("topic", 50, "currently_false")]
    assert again[0].number == 2, "a tick is no step"
    assert not again[0].verdicts[0].explanation, "negative already"
    assert told(feed(B, 60)) == [("topic", 60, "true")]


def test_a_tick_is_forgotten() -> None:
    """`pre` and `since` would tell a step without signals from none."""
    session = session_of(timed('pre {topic: "/a"} or once[:2ns] {topic: "/a"}'))
    feed = Feed(session)
    feed(A, 10)
    assert session.advance(20) == [], "the tick comes next after /a, as far as it knows"
    assert told(feed(B, 21)) == [("topic", 21, "currently_true")]


@pytest.mark.parametrize(("latch", "then"), [(False, "currently_true"), (True, "false")])
def test_only_a_latch_keeps_a_tick(latch: bool, then: str) -> None:
    session = session_of(timed('historically[:9ns] once[:5ns] {topic: "/a"}', latch=latch))
    feed = Feed(session)
    feed(A, 10)
    (tick,) = session.advance(17)
    assert tick.verdicts[0].outcome.value == ("false" if latch else "currently_false")
    assert told(feed(A, 17)) == [("topic", 17, then)]


def test_by_publication_a_tick_waits_for_the_frontiers() -> None:
    session = session_of(timed(ANSWERED), by="publication", max_delay=50)
    feed = Feed(session)
    feed(A, 10)
    for stream in (A, B, MODE):
        found = feed.clock(stream, 12, 30)
    assert told(found) == [("topic", 10, "currently_true")]
    assert session.advance(64) == [], "/b may have spoken before 15, and be under way"
    assert session.next_deadline == 65
    for stream in (A, B, MODE):
        assert feed.clock(stream, 15, 64) == [], "nor has all of 15 passed"
    for stream in (A, B, MODE):
        found = feed.clock(stream, 16, 64)
    assert told(found) == [("tick", 15, "currently_false")]


def test_a_tick_waits_for_those_that_are_still_to_come_back() -> None:
    """After a restart what was said meanwhile is yet to be heard, for as long as it may take from then on."""
    session = session_of(timed(ANSWERED), by="publication", max_delay=50)
    feed = Feed(session)
    feed(A, 10)
    for stream in (A, B, MODE):
        feed.clock(stream, 12, 30)
    session.returning.expect("n")
    assert session.advance(500) == []
    assert [session.next_deadline] == [None]
    session.returning.left("n", 500)
    assert session.next_deadline == 550
    assert session.advance(549) == []
    feed(B, 14, arrived=549)
    assert [stamp for _, stamp, _ in told(session.advance(600))] == [14], "it was in time"


def test_a_tick_waits_no_longer_than_max_delay() -> None:
    session = session_of(timed(ANSWERED), by="publication", max_delay=50)
    feed = Feed(session)
    feed(A, 10)
    assert told(session.advance(65)) == [("topic", 10, "currently_true"), ("tick", 15, "currently_false")]
    assert feed(B, 14, arrived=70) == []
    assert told(session.advance(120)) == [("topic", 14, "true")], "judged as if no tick had been"


def test_a_tick_does_not_overtake_what_is_held() -> None:
    """An event that came within `max_delay` of its stamp is known, and waits for older ones as long as it may."""
    session = session_of(timed(ANSWERED), by="publication", max_delay=50)
    feed = Feed(session)
    feed(A, 10)
    session.advance(60)
    assert feed(B, 15, arrived=62) == []
    assert session.advance(65) == [], "it was in time, and is not judged yet"
    assert session.next_deadline == 112
    assert told(session.advance(112)) == [("topic", 15, "true")]


def test_a_tick_waits_for_what_is_held_no_longer_than_max_delay_twice() -> None:
    """Who is further behind than `max_delay` holds up no deadline."""
    session = session_of(timed(ANSWERED), by="publication", max_delay=50)
    feed = Feed(session)
    feed(A, 10)
    session.advance(60)
    for arrived in (64, 110):
        assert feed(MODE, 14, {"mode": 1}, arrived=arrived) == []
    assert told(session.advance(114)) == [("topic", 14, "currently_true")]
    assert session.next_deadline == 115
    assert told(session.advance(115)) == [("tick", 15, "currently_false")]


def test_delays_below_max_delay_change_nothing_of_what_is_told() -> None:
    """Outcomes, ticks and their times are those of the same events without any delay."""
    for number in range(SEED, SEED + 300):
        rng = random.Random(f"delayed {number}")
        formula = in_nanoseconds(generate.formula(rng, "seconds", rng.randint(2, 4), 1))
        stamps = sorted(rng.sample(range(1, 60), rng.randint(2, 10)))
        sent = [(stamp, rng.choice((A, B, MODE))) for stamp in stamps]
        signals = [{key: rng.choice((1, 2)) for key in "abc" if rng.random() < 0.5} for _ in sent]
        found = []
        for longest in (1, 50):
            session = open_session(
                [Property("p", formula, time="seconds")], attach={"m": [A, B, MODE]}, maker=native, by="publication",
            )  # fmt: skip
            delayed = [(stamp + rng.randrange(longest), n) for n, (stamp, _) in enumerate(sent)]
            latest, lines = dict[StreamKey, int](), []
            for arrived, n in sorted(delayed, key=lambda line: line[1]):
                stamp, stream = sent[n]
                latest[stream] = max(arrived, latest.get(stream, 0))
                lines.append((latest[stream], n, stream, stamp))
            feed, judged = Feed(session), list[Judged]()
            for arrived, n, stream, stamp in sorted(lines):
                judged += feed(stream, stamp, signals[n], arrived=arrived)
            found.append(told(judged + session.advance(200)))
        assert found[0] == found[1], f"{number}: {render(formula, 'seconds')} {sent} {signals}"


def test_a_tick_comes_before_the_event_that_tells_of_its_time() -> None:
    session = session_of(timed(ANSWERED), by="publication", max_delay=None)
    feed = Feed(session)
    feed(A, 10)
    feed(B, 30)
    assert told(feed(MODE, 31)) == [("topic", 10, "currently_true")]
    assert told(feed.clock(A, 30, 40)) == [("tick", 15, "currently_false"), ("topic", 30, "true")]


@pytest.mark.parametrize("ordering", [{"by": "arrival"}, {"max_delay": 0}, {"max_delay": None}, {"max_delay": 50}])
@pytest.mark.parametrize("simulated", [False, True])
def test_what_comes_at_the_very_time_of_a_deadline_comes_before_its_tick(
    ordering: dict[str, Any], simulated: bool
) -> None:
    """A latch would keep the tick for good; where time goes by in steps, as in a simulation, many events come so."""
    session = open_session(
        [timed(ANSWERED, latch=True)], attach={"m": [A, B, MODE]}, streams=[replace(s, latency=0) for s in STREAMS],
        maker=native, **{"by": "publication", **ordering},
    )  # fmt: skip
    if simulated:
        session.simulate()
    feed, found = Feed(session), []
    for now, stream in ((10, A), (15, B), (30, A)):
        for each in (A, B, MODE):
            found += feed.clock(each, now, now)
        found += feed(stream, now)
    judged = told(found + session.finish(30))
    assert judged == [("topic", 10, "currently_true"), ("topic", 15, "true"), ("topic", 30, "true")]


@pytest.mark.parametrize(("stream", "stamp"), [(U, 40), (B, 13), (B, 10)])
def test_a_step_of_an_earlier_time_does_not_hide_a_deadline_that_has_run_out(stream: StreamKey, stamp: int) -> None:
    """An unordered event is judged at the present, which may be long ago; others may come after `max_delay`."""
    for undone in (False, True):
        streams = [replace(s, action="filter", on_deny="undo") if undone else s for s in STREAMS]
        session = open_session(
            [timed('once[:5ns] {topic: "/a"}', guards=frozenset({"/u", "/b"}))],
            attach={"m": [A, B]}, streams=streams, maker=native, max_delay=2,
        )  # fmt: skip
        feed = Feed(session)
        feed(A, 10)
        assert told(session.advance(30)) == [("topic", 10, "currently_true"), ("tick", 16, "currently_false")]
        judged = feed(stream, stamp, arrived=40, ask=undone) + session.advance(50)
        assert told(judged) == [("topic", stamp, "currently_true"), ("tick", 16, "currently_false")]
        assert session.next_deadline is None


def test_a_denied_attempt_of_an_earlier_time_leaves_deadlines_as_they_were() -> None:
    streams = [replace(s, action="filter", on_deny="undo") for s in STREAMS]
    guard = prop("g", "not {v: 9}", guards=frozenset({"/u"}))
    session = open_session(
        [timed('once[:5ns] {topic: "/a"}'), guard], attach={"m": [A]}, streams=streams, maker=native, max_delay=2
    )
    feed = Feed(session)
    feed(A, 10)
    session.advance(30)
    (attempt,) = feed(U, 40, {"v": 9}, ask=True)
    assert attempt.decision
    assert attempt.decision.choice == "deny"
    assert session.judges["publication"].properties[0].outcome in NEGATIVE


def test_while_nothing_is_judged_deadlines_wait() -> None:
    """And who sleeps until the next one is not woken again and again."""
    session = session_of(timed(ANSWERED))
    Feed(session)(A, 10)
    session.suspended = True
    assert session.advance(100) == []
    assert session.next_deadline == 100 + SECOND
    session.suspended = False
    assert told(session.advance(100 + SECOND)) == [("tick", 15, "currently_false")]


def test_what_is_decided_in_part_is_told_though_nothing_is_judged_from_then_on() -> None:
    """Else a step that comes then, or the end, would forget what time had decided before."""
    session = session_of(timed('forall[x]. {v: *x} -> eventually[:5ns] {topic: "/b"}'))
    session.divide(lambda: True)
    feed = Feed(session)
    feed(A, 10, {"v": 1})
    assert session.advance(100) == []
    assert not session.can_be_saved
    session.suspended = True
    assert told(feed(B, 101)) == [("tick", 16, "currently_false"), ("topic", 101, "unknown")]
    (state,) = session.judges["arrival"].properties
    assert (state.violations, state.pending) == (1, 0)


def test_a_tick_sees_what_is_held() -> None:
    session = session_of(timed('once[:5ns] {topic: "/a"} or {mode: 1}'))
    feed = Feed(session)
    feed(MODE, 10, {"mode": 1})
    feed(A, 11)
    assert session.advance(30) == []
    feed(MODE, 31, {"mode": 2})
    assert told(feed(A, 32)) == [("topic", 32, "currently_true")]
    assert told(session.advance(60)) == [("tick", 38, "currently_false")]


def test_judging_again_brings_ticks_back() -> None:
    there, back = (session_of(timed(ANSWERED, latch=True)) for _ in range(2))
    judged = Feed(there)(A, 10) + there.advance(20)
    assert [back.rejudge(j.order, j.step, j.judged) for j in judged] == judged
    for session in (there, back):
        assert told(Feed(session)(B, 30)) == [("topic", 30, "false")]


def test_a_tick_that_changes_nothing_any_more_keeps_its_number() -> None:
    """As where another version judges again: the history has each number once."""
    there, back = session_of(timed(ANSWERED)), session_of(timed('once {topic: "/b"} or not once[5ns:] {mode: 1}'))
    for judged in Feed(there)(A, 10) + there.advance(20):
        back.rejudge(judged.order, judged.step, judged.judged)
    feed = Feed(back)
    feed(MODE, 30, {"mode": 1})
    assert [tick.step.event.seq for tick in back.advance(50)] == [2]


def test_ticks_tell_what_the_table_says_whenever_time_changes_it() -> None:
    """After each moment at which time alone changes what a step without signals would see, that is the outcome."""
    for number in range(SEED, SEED + 300):
        rng = random.Random(f"ticks {number}")
        formula = in_nanoseconds(generate.formula(rng, "seconds", rng.randint(2, 4), 1))
        session = open_session([Property("p", formula, time="seconds")], attach={"m": [A]}, maker=native, by="arrival")
        feed, steps, now = Feed(session), list[TimedSignals](), 1
        for _ in range(rng.randint(1, 5)):
            signals = {key: rng.choice((1, 2)) for key in "abc" if rng.random() < 0.5}
            feed(STREAMS[0].key, now, signals)
            steps.append((now, signals))
            gap, before = rng.choice((0, 1, 3, 6)), None
            for later in range(now + 1, now + gap):
                session.advance(later + 1)
                holds = truths(formula, [*steps, (later, {})], "seconds")[-1]
                state = session.judges["arrival"].properties[0]
                if before is not None and holds is not before and state.outcome.value not in ("true", "false"):
                    assert (state.outcome not in NEGATIVE) is holds, f"{number}: {render(formula, 'seconds')} {steps}"
                before = holds
            now += gap


def changes(session: Session, script: list[tuple[int, dict[str, Any]]]) -> list[tuple[str, int, str]]:
    """How the first property's outcome changes, at which steps and ticks, while time passes."""
    feed, judged, now = Feed(session), list[Judged](), 0
    for gap, signals in script:
        for _ in range(gap):
            now += 1
            judged += session.advance(now)
        judged += feed(STREAMS[0].key, now, signals)
    known = told(judged)
    return [each for before, each in zip([("", 0, "unknown"), *known], known, strict=False) if before[2] != each[2]]


def test_anothers_deadline_is_no_step() -> None:
    alarm = timed("{a: 1} -> {b: 1}")
    script: list[tuple[int, dict[str, Any]]] = [(10, {"a": 1}), (20, {"a": 1})]
    for others in ([], [timed("once[:5ns] {c: 1}")]):
        assert changes(session_of(alarm, *others), script) == [("topic", 10, "currently_false")]


def test_properties_are_judged_as_if_each_were_alone() -> None:
    for number in range(SEED, SEED + 200):
        rng = random.Random(f"beside {number}")
        mine, other = (
            Property(name, in_nanoseconds(generate.formula(rng, "seconds", rng.randint(2, 4), 1)), time="seconds")
            for name in "pq"
        )
        script = [
            (rng.choice((1, 1, 3, 7)), {key: rng.choice((1, 2)) for key in "abc" if rng.random() < 0.5})
            for _ in range(6)
        ]
        alone, beside = changes(session_of(mine), script), changes(session_of(mine, other), script)
        assert alone == beside, f"{number}: {render(mine.formula, 'seconds')} {render(other.formula, 'seconds')}"


def in_nanoseconds(formula: Formula) -> Formula:
    """The formula with its bounds of seconds taken as nanoseconds."""
    parts: dict[str, Any] = {
        name: in_nanoseconds(part)
        for name in ("operand", "left", "right", "body")
        if (part := getattr(formula, name, None)) is not None
    }
    if isinstance(formula, Once | Historically | Since):
        bound = formula.bound
        parts["bound"] = Bound(bound.lower // SECOND, None if bound.upper is None else bound.upper // SECOND)
    if hasattr(formula, "variable"):
        parts["variable"] = formula.variable
    return type(formula)(**parts) if parts else formula
