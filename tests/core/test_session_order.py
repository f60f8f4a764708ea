"""A session's order: monitors together, clocks, orders side by side, stamps and time."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.engine import Engine
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.stamps import Stamp
from oracle_server.core.verdicts import Decision
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import (
    MAX_DELAY,
    A,
    B,
    Feed,
    Recorder,
    U,
    degraded,
    open_session,
    outcomes,
    prop,
    stamps,
)

MS = 10**6
ANY = prop("any", "once {v: 1}")


def recorded(**ordering: Any) -> tuple[Session, list[Recorder]]:
    """A session of one property whose engines record when they were stepped."""
    engines: list[Recorder] = []

    def maker(_: Property) -> Engine:
        engines.append(Recorder())
        return engines[-1]

    return open_session([ANY], attach={"m": [A, B, U]}, maker=maker, **ordering), engines


def test_two_monitors_are_ordered_together() -> None:
    session = open_session([prop("p", '{topic: "/a"} -> pre {topic: "/b"}')], attach={"m": [A], "n": [B]})
    feed = Feed(session)
    assert feed(A, 100, arrived=101) == []
    judged = feed(B, 90, monitor="n", arrived=102)
    assert stamps(judged) == [90]
    assert session.next_deadline == 101 + MAX_DELAY
    judged += feed(B, 100, monitor="n", arrived=103) + feed(B, 120, monitor="n", arrived=121)
    assert stamps(judged) == [90, 100, 100]
    assert [j.step.event.monitor for j in judged] == ["n", "m", "n"], "ties are in the order of arrival"
    assert outcomes(judged) == ["currently_true"] * 3
    assert [j.judged for j in judged] == [102, 103, 103]


def test_nothing_waits_longer_than_max_delay() -> None:
    session = open_session([ANY], attach={"m": [A, B]})
    feed = Feed(session)
    assert feed(A, 100) + feed(A, 110) + feed(B, 90, arrived=120) != []
    assert session.advance(149) == []
    assert stamps(session.advance(150)) == [100]
    assert session.next_deadline == 160
    judged = feed(B, 105, arrived=160)
    assert stamps(judged) == [110, 105], "what is due is judged before what arrives"
    assert [j.step.late for j in judged] == [False, True]
    assert feed(A, 130, arrived=161) == []
    assert stamps(session.finish(170)) == [130]
    assert session.next_deadline is None


def test_without_max_delay_every_stream_is_waited_for() -> None:
    session = open_session([ANY], attach={"m": [A, B]}, max_delay=None)
    feed = Feed(session)
    assert feed(A, 100) == []
    assert session.next_deadline is None
    assert session.advance(10**18) == []
    assert stamps(feed.clock(B, 100, now=0)) == [100]


def test_a_clock_speaks_for_its_own_monitor_and_stream() -> None:
    session = open_session([ANY], attach={"m": [A, B], "n": [B]})
    feed = Feed(session)
    feed(A, 100)
    assert feed.clock(B, 100, now=101) == []
    assert feed.clock(A, 200, now=102, monitor="n") == [], "of a stream that it does not observe"
    assert stamps(feed.clock(B, 99, now=103, monitor="n")) == []
    assert stamps(feed.clock(B, 100, now=104, monitor="n")) == [100]
    assert stamps(feed(A, 150) + feed.clock(B, 150, now=199) + feed.clock(B, 300, now=200, monitor="n")) == [150]


def test_publishers_of_one_stream_are_told_apart() -> None:
    session = open_session([ANY], attach={"m": [A]})
    feed = Feed(session)
    judged = feed(A, 100, source="slow") + feed(A, 100, source="fast") + feed(A, 120, source="fast")
    assert stamps(judged + feed(A, 110, arrived=121, source="slow")) == [100, 100, 110]
    assert stamps(session.finish(122)) == [120]


def test_detaching_lets_the_others_go_on() -> None:
    session = open_session([ANY], attach={"m": [A], "n": [B]}, max_delay=None)
    feed = Feed(session)
    assert feed(A, 100) + feed(B, 90, monitor="n") + feed(A, 110) != []
    assert feed(B, 95, monitor="n") != []
    judged = session.detach("n", 111)
    assert stamps(judged) == [100, 110]
    assert stamps(feed(A, 120)) == [120]
    assert session.attach("n", [B], 121) == []
    assert feed(A, 130) == [], "waited for from the moment it attaches"


def test_an_unordered_stream_is_judged_at_once_and_makes_nothing_late() -> None:
    session, (engine,) = recorded()
    feed = Feed(session)
    judged = feed(A, 100) + feed(B, 105) + feed(U, 500, arrived=106) + feed(U, 1, arrived=107)
    judged += feed(A, 120) + feed(U, 7, arrived=121)
    assert stamps(judged) == [100, 500, 1, 105, 7], "it waits for nothing"
    assert engine.times == [100, 100, 100, 105, 105], "at the session's present"
    assert not any(j.step.late for j in judged)
    assert session.attach("x", [U], 130) == []
    assert stamps(feed(B, 131)) == [120], "an unordered stream is never waited for"


def test_by_arrival_nothing_waits_and_nothing_is_late() -> None:
    session, (engine,) = recorded(by="arrival")
    feed = Feed(session)
    judged = feed(A, 100, arrived=200) + feed(B, 50, arrived=201) + feed(A, 300, arrived=201) + feed(U, 9, arrived=205)
    assert stamps(judged, "arrival") == [100, 50, 300, 9]
    assert engine.times == [200, 201, 201, 205]
    assert not any(j.step.late for j in judged)
    assert session.finish(206) == []


def test_both_orders_side_by_side() -> None:
    properties = [prop("p", '{topic: "/b"} -> once {topic: "/a"}', guards=frozenset({"/b"}))]
    session = open_session(properties, attach={"m": [A, B]}, by="both")
    feed = Feed(session)
    judged = feed(B, 100, arrived=110, ask=True) + feed(A, 90, arrived=111) + feed(A, 120, arrived=121)
    judged += session.finish(130)
    assert [(j.order, j.step.stamp) for j in judged] == [
        ("arrival", 100),
        ("arrival", 90),
        ("publication", 90),
        ("arrival", 120),
        ("publication", 100),
        ("publication", 120),
    ]
    assert outcomes(judged) == ["currently_false", *["currently_true"] * 5]
    assert [j.decision for j in judged if j.step.stamp == 100] == [None, Decision("allow", ())]


def test_a_stamp_too_far_ahead_is_ordered_at_its_arrival() -> None:
    session, (engine,) = recorded(max_skew=30)
    feed = Feed(session)
    judged = feed(A, 131, arrived=100) + feed(B, 110) + feed(B, 141, arrived=111) + feed(A, 145, arrived=150)
    assert [(j.step.stamp, j.step.skewed, j.step.time) for j in judged] == [
        (131, True, 100),
        (110, False, 110),
        (141, False, 141),
    ]
    assert engine.times == [100, 110, 141]
    assert session.judges["publication"].counters.skewed == 1
    assert not any(j.step.late for j in judged)


HEADER = {"header": {"stamp": {"sec": 0, "nanosec": 70}}}


@pytest.mark.parametrize(
    ("stamp", "data", "path", "expected"),
    [
        (60, HEADER, None, 60),
        (None, HEADER, None, 70),
        (0, HEADER, None, 70),
        (None, {"header": {"stamp": {"secs": 0, "nsecs": 71}}}, None, 71),
        (None, {"header": {"stamp": {"sec": 0, "nanosec": 0}}, "stamp": {"sec": 0, "nanosec": 72}}, None, 72),
        (None, {"stamp": 7.3e-8}, None, 73),
        (None, {"deep": {"at": {"sec": 0, "nanosec": 74}}, **HEADER}, "deep.at", 74),
        (None, {"stamp": {"sec": 0, "nanosec": 0}}, None, 100),
        (None, {"header": "none", "stamp": "noon"}, None, 100),
        (None, {"stamp": -1}, None, 100),
        (None, HEADER, "gone.at", 100),
        (None, "no fields", None, 100),
    ],
)
def test_the_stamp_is_where_the_spec_says_or_the_arrival(
    stamp: int | None, data: object, path: str | None, expected: int
) -> None:
    session = open_session([ANY], attach={}, streams=[StreamSpec("/a", stamp=Stamp(path) if path else None)])
    (judged,) = Feed(session)(A, stamp, data, arrived=100)
    assert judged.step.stamp == expected


@pytest.mark.parametrize("by", ["publication", "arrival", "both"])
def test_time_never_goes_back(by: str) -> None:
    session, engines = recorded(by=by)
    feed = Feed(session)
    judged = feed(A, 100) + feed(B, 100, arrived=90) + feed(A, 80, arrived=70) + feed(B, 120, arrived=60)
    judged += session.advance(50) + feed(U, 10, arrived=10) + session.finish(0)
    assert [j.judged for j in judged] == [100] * len(judged)
    assert all(engine.times == sorted(engine.times) for engine in engines)
    assert all(len(engine.times) == 5 for engine in engines)
    assert session.now == 100


def test_a_loss_degrades_what_is_held_from_when_it_is_known() -> None:
    session = open_session([ANY], attach={"m": [A, B]}, by="both")
    feed = Feed(session)
    judged = feed(A, 100) + feed(B, 90, arrived=101)
    assert degraded(judged) == [False] * 3
    judged = feed(A, 120, arrived=121, lost=3) + session.finish(122)
    assert degraded(judged) == [True] * 3
    assert stamps(judged) == [100, 120], "the first of them was there before the loss was told"


def test_a_clock_that_is_far_ahead_speaks_for_the_present_alone() -> None:
    """As an event does that is stamped so: its promise would hold for an hour in which the robot is right again."""
    ahead = 3600 * 10**9
    session = open_session([ANY], attach={"m": [A, B]}, max_skew=50)
    feed = Feed(session)
    assert feed.clock(A, ahead, now=10) == feed.clock(B, ahead, now=10) == []
    assert session.buffer.frontiers == {("m", A): 10, ("m", B): 10}
    assert feed(A, 100, arrived=101) == []
    judged = feed(B, 90, arrived=102) + feed.clock(B, 100, now=103)
    assert stamps(judged) == [90, 100]
    assert not any(j.step.late or j.step.skewed for j in judged)
    assert feed.clock(A, 160, now=110) == feed.clock(B, 159, now=110) == [], "as far as is allowed it is believed"
    assert session.buffer.frontiers == {("m", A): 160, ("m", B): 159}


def test_a_clock_that_is_far_ahead_lets_no_deadline_pass() -> None:
    soon = prop("soon", '{topic: "/b"} -> eventually[:40ns] {topic: "/a"}', time="seconds")
    session = open_session(
        [soon], attach={"m": [A, B]}, maker=lambda p: NativeEngine(p.formula, p.time), max_skew=50, max_delay=None
    )
    feed = Feed(session)
    ahead = 3600 * 10**9
    judged = feed(B, ahead + 10, arrived=10) + feed.clock(A, ahead + 12, now=12) + feed.clock(B, ahead + 12, now=12)
    judged += feed(A, ahead + 45, arrived=45) + feed.clock(A, ahead + 60, now=60) + feed.clock(B, ahead + 60, now=60)
    assert "currently_false" not in outcomes(judged)
    assert session.judges["publication"].properties[0].violations == 0


def test_a_publisher_that_has_gone_is_spoken_for_by_the_clock() -> None:
    session = open_session([ANY], attach={"m": [A]}, max_delay=None)
    feed = Feed(session)
    feed(A, 100, source="gone")
    assert feed(A, 200, source="here") == []
    assert session.advance(10**18) == []
    assert stamps(feed.clock(A, 200, now=201)) == [200]


def test_the_first_of_all_does_not_set_the_time_ahead() -> None:
    session, (engine,) = recorded()
    feed = Feed(session)
    judged = feed(U, 10**9, arrived=90) + feed(A, 100) + feed(B, 110)
    assert stamps(judged) == [10**9, 100]
    assert engine.times == [90, 100]


def test_time_goes_on_where_no_stream_is_ordered() -> None:
    engine = Recorder()
    session = open_session([ANY], attach={"m": [U]}, streams=[StreamSpec("/u", ordered=False)], maker=lambda _: engine)
    feed = Feed(session)
    assert len(feed(U, 100) + feed(U, 190, arrived=200) + feed(U, 150, arrived=201) + feed(U, 900, arrived=300)) == 4
    assert engine.times == [100, 190, 190, 300]


def test_what_is_counted_of_the_order() -> None:
    session = open_session([ANY], attach={"m": [A, B]}, by="both", max_delay=None)
    feed = Feed(session)
    feed(A, 10 * MS, arrived=10 * MS)
    feed(B, 10 * MS, arrived=13 * MS, lost=2)
    feed(B, 5 * MS, arrived=14 * MS)
    assert session.next_deadline is None
    counts = {source[1]: (c.late, c.lost) for source, c in session.counts.items()}
    assert counts == {B: (1, 2)}
    holds = session.holds
    assert (holds.count, holds.total) == (3, 3 * MS)
    assert holds.buckets[:4] == [2, 0, 1, 0]
