"""Simulated time: stamps, arrivals and skew are in it; how long an event waits is not."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

from oracle_server.core.engine import Engine
from oracle_server.core.ordering.monitorclocks import MonitorClocks
from oracle_server.core.ordering.simulated import ClockReading, SimulatedTime
from oracle_server.core.session import Session
from oracle_server.core.spec import SECOND, Property, StreamSpec
from oracle_server.core.stamps import Stamp
from tests.core.sessions import MAX_DELAY, A, B, Feed, Recorder, open_session, prop, stamps
from tests.core.test_ticks import native

REAL = 1_000_000
"""The server's time, far from the simulation's."""
STREAMS = (StreamSpec("/a", latency=5), StreamSpec("/b", latency=5))


def simulated(**ordering: Any) -> tuple[Session, Feed, Recorder]:
    engine = Recorder()

    def maker(_: Property) -> Engine:
        return engine

    session = open_session([prop("any", "once {v: 1}")], attach={"m": [A, B]}, streams=STREAMS, maker=maker, **ordering)
    session.simulate()
    return session, Feed(session), engine


def test_an_event_arrives_in_simulated_time_and_waits_in_the_server_s() -> None:
    session, feed, engine = simulated()
    feed.clock(A, 95, REAL)
    feed.clock(B, 95, REAL)
    assert feed(A, 100, arrived=REAL) == []
    assert session.next_deadline == REAL + MAX_DELAY
    (judged,) = session.advance(REAL + MAX_DELAY)
    assert (judged.step.event.arrived, judged.step.event.received) == (100, REAL)
    assert judged.judged == REAL + MAX_DELAY
    assert engine.times == [100]


def test_what_has_no_stamp_has_the_simulation_s_time() -> None:
    _session, feed, _ = simulated()
    feed.clock(A, 95, REAL)
    feed.clock(B, 95, REAL)
    judged = feed(A, None, arrived=REAL) + feed(B, 99, arrived=REAL) + feed.clock(B, 100, REAL)
    assert stamps(judged) == [99, 100]


def test_a_stamp_of_the_wall_clock_is_ordered_at_its_arrival() -> None:
    session, feed, _ = simulated(max_skew=30)
    feed.clock(A, 95, REAL)
    feed.clock(B, 95, REAL)
    judged = feed(A, REAL, arrived=REAL) + feed(B, 130, arrived=REAL) + session.finish(REAL)
    assert [(j.step.time, j.step.skewed) for j in judged] == [(100, True), (130, False)]


def test_before_a_clock_has_told_it_the_stamp_is_the_time() -> None:
    session, feed, _ = simulated(max_skew=30)
    judged = feed(A, 500, arrived=REAL) + feed(A, None, arrived=REAL) + session.finish(REAL)
    assert [(j.step.time, j.step.skewed) for j in judged] == [(500, False), (500, False)]


def test_by_arrival_time_is_simulated_too() -> None:
    _, feed, engine = simulated(by="arrival")
    feed.clock(A, 95, REAL)
    feed(B, 60, arrived=REAL)
    feed.clock(A, 195, REAL + 1)
    feed(B, 70, arrived=REAL + 1)
    assert engine.times == [100, 200]


def test_a_clock_goes_back_where_a_stream_s_reading_does() -> None:
    session, _, _ = simulated(max_skew=0)
    session.clock("m", [ClockReading(A, 100), ClockReading(B, 90)], REAL)
    assert session.simulated is not None
    assert session.simulated.now == 105
    assert not session.goes_back("m", [ClockReading(A, 100), ClockReading(B, 90)])
    assert not session.goes_back("n", [ClockReading(A, 1)]), "another monitor may hear of the time later"
    session.clocks.leave("m")
    assert session.goes_back("n", [ClockReading(A, 1)]), "but not where none is there that has told it"
    assert not session.goes_back("n", [ClockReading(A, 100)])
    assert session.goes_back("m", [ClockReading(A, 100), ClockReading(B, 89)])


def test_deadlines_wait_in_the_server_s_time_however_fast_the_simulation_is() -> None:
    lives = prop("p", 'once[:100ns] {topic: "/a"}', time="seconds")
    session = open_session([lives], attach={"m": [A], "n": [B]}, streams=STREAMS, maker=native, max_skew=10**6)
    session.simulate()
    feed = Feed(session)
    feed.clock(A, 1_000, REAL)
    feed.clock(B, 1_000, REAL, monitor="n")
    feed(A, 1_000, arrived=REAL)
    feed.clock(A, 1_001, REAL)
    feed.clock(B, 9_000, REAL + 1, monitor="n")
    assert session.next_deadline == REAL + 1 + MAX_DELAY, "also of a simulation that is paused then"
    assert session.advance(REAL + MAX_DELAY) == []
    assert [row.step.stamp for row in session.advance(REAL + 1 + MAX_DELAY)] == [1_101]


def test_when_the_clock_reached_a_time_is_never_said_to_be_too_early() -> None:
    rng = random.Random(7)
    time, told = SimulatedTime({s.key: replace(s, latency=0) for s in STREAMS}, kept=1_000), list[tuple[int, int]]()
    server, now = 0, 0
    for _ in range(3_000):
        server, now = server + rng.choice((0, 1, 7)), now + rng.choice((0, 3, 50))
        time.update([ClockReading(A, now)], server)
        told.append((server, now))
        ago = server - rng.randrange(1_000)
        known = max((sim for at, sim in told if at <= ago), default=None)
        found = time.at(ago)
        assert (found or 0) <= (known or 0)
        before = max((sim for at, sim in told if at <= ago - 1_000 // 256), default=None)
        assert before is None or (found is not None and found >= before)
        assert found is None or (time.reached(found) or 0) <= ago


def restarted(**ordering: Any) -> tuple[Session, Feed]:
    """A session that was judged up to 1,000, without a clock since."""
    session, feed, _ = simulated(max_skew=30, **ordering)
    for stream in (A, B):
        feed.clock(stream, 995, REAL)
    feed(A, 1_000, arrived=REAL)
    session.finish(REAL)
    session.simulate()
    session.clocks = MonitorClocks(session.plan.spec.by_key, session.plan.spec.ordering.max_skew)
    return session, feed


def test_a_restarted_simulation_is_noticed_by_its_first_clock() -> None:
    for reading, back in ((960, True), (966, False), (5_000, False)):
        session, _ = restarted()
        assert session.goes_back("n", [ClockReading(A, reading)]) is back
        session.clocks.trust("m", wall=False)
        assert not session.goes_back("m", [ClockReading(A, 1)]), "the same process may still be behind"


def test_after_a_restart_the_time_is_that_of_before_until_a_clock_tells_it() -> None:
    session, feed = restarted()
    judged = (
        feed(A, REAL + 20, arrived=REAL + 40) + feed(B, None, arrived=REAL + 41) + feed(A, 5_000, arrived=REAL + 42)
    )
    judged += feed(B, None, arrived=REAL + 43) + session.finish(REAL + 43)
    assert [(j.step.time, j.step.skewed) for j in judged] == [
        (1_000, True),
        (1_000, False),
        (5_000, False),
        (5_000, False),
    ]


def test_before_the_first_clock_of_all_a_stamp_of_the_wall_clock_is_none() -> None:
    session, feed, _ = simulated(max_skew=30)
    session.begun = None
    judged = feed(A, REAL - 20, arrived=REAL)
    assert session.begun is None, "nothing is missed since 1970"
    judged += feed.clock(A, 95, REAL) + feed.clock(B, 95, REAL) + feed(A, 100, arrived=REAL) + session.finish(REAL)
    assert [(j.step.time, j.step.skewed, j.step.late) for j in judged] == [(0, True, False), (100, False, False)]
    assert session.begun == 100


def test_a_robot_s_clock_is_never_fixed_by_the_server_s_time() -> None:
    streams = [replace(STREAMS[0], stamp=Stamp("t", epoch="boot", unit="ns")), STREAMS[1]]
    session = open_session(
        [prop("any", "once {v: 1}")], attach={"m": [A, B]}, streams=streams, maker=native, max_skew=30
    )
    session.simulate()
    feed = Feed(session)
    judged = feed(B, 90, arrived=REAL) + feed(A, None, {"t": 7}, arrived=REAL)
    judged += feed.clock(A, 95, REAL) + feed.clock(B, 95, REAL) + feed(A, None, {"t": 17}, arrived=REAL)
    judged += feed.clock(A, 115, REAL) + feed(A, None, {"t": 30}, arrived=REAL) + session.finish(REAL)
    assert [(j.step.event.stream, j.step.time) for j in judged] == [(B, 90), (A, 90), (A, 100), (A, 113)]


def test_a_wall_clock_goes_back_where_it_is_set_back_by_more_than_clocks_may_differ() -> None:
    """All that came was late, and judged at the time that had been reached."""
    session = open_session([prop("any", "once {v: 1}")], attach={"m": [A]}, streams=STREAMS, max_skew=2 * SECOND)
    feed = Feed(session)
    feed.clock(A, 100 * SECOND, 100 * SECOND)
    assert not session.goes_back("m", [ClockReading(A, 98 * SECOND)])
    assert session.goes_back("m", [ClockReading(A, 98 * SECOND - 1)])
    assert not session.goes_back("n", [ClockReading(A, 1)]), "another machine's clock may be behind"
    feed(A, 100 * SECOND, arrived=100 * SECOND)
    session.advance(101 * SECOND)
    session.clocks.leave("m")
    assert not session.goes_back("n", [ClockReading(A, 98 * SECOND - 5)])
    assert session.goes_back("n", [ClockReading(A, 98 * SECOND - 6)])


def test_by_arrival_no_clock_goes_back_and_no_clock_is_exact() -> None:
    for by, back in (("arrival", False), ("both", True)):
        session = open_session([prop("any", "once {v: 1}")], attach={"m": [A]}, streams=STREAMS, max_skew=0, by=by)
        Feed(session).clock(A, 100 * SECOND, 100 * SECOND)
        assert not session.goes_back("m", [ClockReading(A, 99 * SECOND)]), "a clock is set right by less, often"
        assert session.goes_back("m", [ClockReading(A, 98 * SECOND)]) is back


def test_a_wall_clock_that_was_further_ahead_than_is_believed_is_set_right_and_goes_not_back() -> None:
    """What came by it was ordered as it arrived: what comes by the right time is not late."""
    session = open_session([prop("any", "once {v: 1}")], attach={"m": [A]}, streams=STREAMS, max_skew=SECOND)
    feed, now = Feed(session), 100 * SECOND
    feed.clock(A, now + 1800 * SECOND, now)
    feed(A, now + 1800 * SECOND, arrived=now)
    assert session.clocks.apart("m") == 1800 * SECOND + 5
    assert not session.goes_back("m", [ClockReading(A, now)])
    feed.clock(A, now, now)
    (judged,) = feed(A, now + 1, arrived=now + 2) + session.advance(now + SECOND)
    assert (session.clocks.apart("m"), judged.step.late, judged.step.skewed) == (0, False, False)


def test_who_connects_again_may_tell_what_its_wall_clock_had_told_before_what_it_sends_again() -> None:
    session = open_session([prop("any", "once {v: 1}")], attach={"m": [A]}, streams=STREAMS)
    feed = Feed(session)
    feed.clock(A, 100 * SECOND, 100 * SECOND)
    session.clocks.trust("m", wall=True)
    assert not session.goes_back("m", [ClockReading(A, 50 * SECOND)])
    feed.clock(A, 50 * SECOND, 100 * SECOND)
    assert session.goes_back("m", [ClockReading(A, 40 * SECOND)])
