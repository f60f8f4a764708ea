"""Simulated time: stamps, arrivals and skew are in it; how long an event waits is not."""

from __future__ import annotations

from typing import Any

from oracle_server.core.engine import Engine
from oracle_server.core.session import Session
from oracle_server.core.simulated import ClockReading, SimulatedTime
from oracle_server.core.spec import Property, StreamSpec
from tests.core.sessions import MAX_DELAY, A, B, Feed, Recorder, open_session, prop, stamps

REAL = 1_000_000
"""The server's time, far from the simulation's."""
STREAMS = (StreamSpec("/a", latency=5), StreamSpec("/b", latency=5))


def simulated(**ordering: Any) -> tuple[Session, Feed, Recorder]:
    engine = Recorder()

    def maker(_: Property) -> Engine:
        return engine

    session = open_session([prop("any", "once {v: 1}")], attach={"m": [A, B]}, streams=STREAMS, maker=maker, **ordering)
    session.simulated = SimulatedTime(session.plan.spec.by_key)
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
    time = SimulatedTime({s.key: s for s in STREAMS})
    time.update("m", [ClockReading(A, 100), ClockReading(B, 90)])
    assert time.now == 105
    assert not time.goes_back("m", [ClockReading(A, 100), ClockReading(B, 90)])
    assert not time.goes_back("n", [ClockReading(A, 1)]), "another monitor may hear of the time later"
    assert time.goes_back("m", [ClockReading(A, 100), ClockReading(B, 89)])
