"""What never comes: a presence property is judged from the first monitor's attaching on, after its grace."""

from __future__ import annotations

import random
from typing import Any

import pytest

from oracle_server.core.events import Event
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import And, Bound, Once
from oracle_server.core.judging.presence import grace
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import Judged, Outcome, record
from oracle_server.engines.native import NativeEngine
from tests import brute, generate
from tests.core.sessions import MODE, STREAMS, A, B, Feed, open_session, prop
from tests.core.test_ticks import in_nanoseconds, native, timed, told
from tests.engines.test_against_brute import SEED

SCAN = timed('once[:50ns] {topic: "/a"}')


def session_of(*properties: Property, at: int | None = 100, **ordering: Any) -> Session:
    session = open_session(list(properties), attach={}, maker=native, **{"by": "arrival", **ordering})
    if at is not None:
        assert session.attach("m", [A, B, MODE], at) == []
    return session


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("once[:5ns] {a}", 5),
        ("once[2ns:5ns] pre {a}", 5),
        ("once[:5ns] {a} and once[:9ns] {b} and once[:7ns] not {b}", 9),
        ("once {a}", 0),
        ("once[3ns:] {a}", 0),
        ("{b} -> once[:5ns] {a}", 0),
        ("once[:5ns] {a} or once[:9ns] {b}", 0),
        ("once[:5ns] {a} and {b}", 0),
        ("not once[:5ns] {a}", 0),
        ("historically[:5ns] once[:5ns] {a}", 0),
    ],
)
def test_which_formulas_demand_nothing_but_presence(formula: str, expected: int) -> None:
    assert grace(parse_formula(formula, "seconds"), "seconds") == expected


def test_steps_give_no_grace() -> None:
    assert grace(parse_formula("once[:5] {a}", "steps"), "steps") == 0


def test_who_never_speaks_is_missed_when_the_grace_is_over() -> None:
    session = session_of(SCAN)
    assert session.next_deadline == 151
    assert session.advance(150) == []
    (tick,) = session.advance(400)
    assert told([tick]) == [("tick", 150, "currently_false")]
    row = record(tick, tick.verdicts[0])
    assert (row["n"], row["step"], row["violation"], row["degraded"]) == (1, None, True, False)
    assert row["explanation"] is not None
    assert row["explanation"]["text"] == (
        'p does not hold when a deadline ran out at 0.000000150 s: once[:50ns] {topic: "/a"}: none in the last 50ns'
    )
    assert [session.next_deadline] == [None]
    feed = Feed(session)
    (first,) = feed(A, 500)
    assert (first.number, told([first])) == (1, [("topic", 500, "currently_true")])
    assert told(session.advance(600)) == [("tick", 551, "currently_false")]


def test_by_publication_it_is_missed_once_it_can_not_be_under_way_any_more() -> None:
    session = session_of(SCAN, by="publication", max_delay=30)
    assert session.next_deadline == 180
    assert session.advance(179) == []
    assert told(session.advance(180)) == [("tick", 150, "currently_false")]
    assert Feed(session)(A, 140, arrived=190) == []
    assert told(session.advance(230)) == [("topic", 140, "currently_true"), ("tick", 191, "currently_false")]


def test_within_the_grace_what_is_missing_is_not_known_to_be() -> None:
    session = session_of(SCAN)
    feed = Feed(session)
    state = session.judges["arrival"].properties[0]
    assert told(feed(B, 149)) == [("topic", 149, "unknown")]
    assert (state.failures, state.violations) == (0, 0)
    (judged,) = feed(B, 150)
    assert told([judged]) == [("topic", 150, "currently_false")]
    assert not judged.verdicts[0].degraded, "what could not be known is no failure"
    assert session.advance(400) == [], "the deadline itself was judged"


def test_what_came_within_the_grace_holds() -> None:
    feed = Feed(session_of(SCAN))
    assert told(feed(A, 110) + feed(B, 149)) == [("topic", 110, "currently_true"), ("topic", 149, "currently_true")]


def test_within_the_grace_a_guarded_event_is_denied() -> None:
    streams = [StreamSpec("/a"), StreamSpec("/b", action="filter", on_deny="undo")]
    guard = timed('once[:50ns] {topic: "/a"}', guards=frozenset({"/b"}), blame="caused")
    session = open_session([guard], attach={}, streams=streams, maker=native, by="arrival")
    session.attach("m", [A, B], 100)
    (judged,) = Feed(session)(B, 120, ask=True)
    assert judged.decision is not None
    assert (judged.decision.choice, told([judged])) == ("deny", [("topic", 120, "unknown")])
    assert told(session.advance(400)) == [("tick", 150, "currently_false")]


def test_a_latch_does_not_keep_what_was_not_known() -> None:
    session = session_of(timed('once[:50ns] {topic: "/a"}', latch=True))
    feed = Feed(session)
    assert told(feed(B, 120) + feed(A, 130)) == [("topic", 120, "unknown"), ("topic", 130, "currently_true")]
    assert told(session.advance(400)) == [("tick", 181, "false")]


def test_other_properties_are_unknown_until_the_first_step() -> None:
    others = [prop("q", "once {b}", time="seconds"), prop("r", "{b}"), prop("s", "once[3ns:] not {b}", time="seconds")]
    session = session_of(SCAN, *others)
    (tick,) = session.advance(400)
    assert [v.outcome.value for v in tick.verdicts] == ["currently_false", "unknown", "unknown", "unknown"]


def test_in_both_orders_each_misses_it() -> None:
    session = session_of(SCAN, by="both", max_delay=20)
    assert sorted((j.order, j.step.stamp) for j in session.advance(400)) == [("arrival", 150), ("publication", 150)]


def test_a_simulation_begins_with_its_first_clock() -> None:
    session = session_of(SCAN, at=None, by="publication", max_delay=0)
    session.simulate()
    assert session.attach("m", [A, B, MODE], 77_000) == []
    for stream in (A, B, MODE):
        assert session.clock("m", [ClockReading(stream, 1_000)], 77_001) == []
    begun = 1_000 + STREAMS[0].latency
    assert session.begun == begun
    found = [j for stream in (A, B, MODE) for j in session.clock("m", [ClockReading(stream, begun + 60)], 77_002)]
    assert [tick.step.stamp for tick in found] == [begun + 50]


def test_without_times_of_arrival_the_grace_begins_with_the_first_stamp() -> None:
    spec = session_of(SCAN, at=None).plan
    session = Session(spec, [[NativeEngine(SCAN.formula, "seconds")]], ticking=False)
    feed = Feed(session)
    assert session.attach("m", [A, B, MODE], 100) == []
    assert [t[2] for t in told(feed(B, 100) + feed(B, 149) + feed(B, 150))] == ["unknown", "unknown", "currently_false"]


def test_a_clock_that_is_far_behind_does_not_prolong_the_grace() -> None:
    session = session_of(SCAN, by="publication", max_delay=None, max_skew=20)
    feed = Feed(session)
    assert told(feed(B, 3, arrived=160)) == []
    judged = [j for stream in (A, MODE) for j in feed.clock(stream, 4, 165)]
    judged += [*feed(B, 5, arrived=175), *feed.clock(A, 6, 176), *feed.clock(MODE, 6, 177)]
    assert told(judged) == [("topic", 3, "unknown"), ("topic", 5, "currently_false")]


def test_who_attaches_later_begins_nothing_anew() -> None:
    session = session_of(SCAN)
    session.attach("n", [A], 130)
    assert session.begun == 100
    assert told(session.advance(400)) == [("tick", 150, "currently_false")]


def test_judging_again_brings_the_first_tick_back_and_an_older_history_has_no_grace() -> None:
    there = session_of(SCAN, at=100)
    judged = there.advance(200) + Feed(there)(B, 210)
    back = open_session([SCAN], attach={}, maker=native, by="arrival", begun=100)
    assert [back.rejudge(j.order, j.step, j.judged) for j in judged] == judged
    older = open_session([SCAN], attach={}, maker=native, by="arrival", begun=0)
    early = Feed(session_of(SCAN))(B, 110)
    again = [older.rejudge(j.order, j.step, j.judged) for j in early]
    assert told([j for j in again if j]) == [("topic", 110, "currently_false")]
    assert older.attach("m", [A], 111) == []


def test_random_silences_are_missed_as_the_table_says() -> None:
    """Ticks before the first step, at whatever is demanded: then there is one step, that without signals."""
    missed = 0
    for number in range(SEED, SEED + 400):
        rng = random.Random(f"presence {number}")
        parts = [
            Once(in_nanoseconds(generate.formula(rng, "seconds", rng.randint(0, 3), 1)), Bound(0, rng.randint(1, 9)))
            for _ in range(rng.choice((1, 1, 2)))
        ]
        formula = parts[0] if len(parts) == 1 else And(*parts)
        session = open_session([Property("p", formula, time="seconds")], attach={}, maker=native, by="arrival")
        session.attach("m", [A], 100)
        text = f"case {number}: {render(formula, 'seconds')}"
        steps, now, judged = list[brute.TimedSignals](), 100, list[Judged]()
        for seq in range(1, rng.randint(2, 6)):
            now += rng.choice((0, 1, 3, 6, 20))
            signals = {key: rng.choice((1, 2)) for key in "abc" if rng.random() < 0.5}
            judged += session.ingest(Event(A, "m", seq, now, now, signals))
            steps.append((now, signals))
        judged += session.advance(now + 50)
        seen = list[brute.TimedSignals]()
        for one in judged:
            is_tick = one.number is None
            moment = (one.step.stamp, {}) if is_tick else steps[len(seen)]
            holds = brute.judged(formula, [*seen, moment], "seconds", 100)[-1]
            outcome = one.verdicts[0].outcome
            if is_tick and not seen:
                missed += 1
                assert moment[0] == 100 + grace(formula, "seconds"), text
            assert (None if outcome is Outcome.UNKNOWN else outcome.current is Outcome.CURRENTLY_TRUE) is holds, text
            if not is_tick:
                seen.append(moment)
        assert seen == steps
    assert missed > 20
