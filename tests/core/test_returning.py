"""After a restart deadlines wait for what the monitors kept meanwhile."""

from __future__ import annotations

from dataclasses import replace

import pytest

from oracle_server.core.ordering.returning import MOST, SILENT, Returning
from oracle_server.core.session import Session
from tests.core.sessions import MODE, STREAMS, A, B, Feed, open_session, prop
from tests.core.test_ticks import native, told

LIVES = prop("p", 'once[:100ns] {topic: "/b"}', time="seconds")
BACK = 5_000
"""When the monitors are back, by the server's time; in a simulation too, its time is far behind that."""
SIM = pytest.mark.parametrize("simulated", [False, True])


def returned(simulated: bool, *, others: bool = False, anew: bool = False) -> tuple[Session, Feed]:
    """A session that heard /b at 10, whose monitors come back at `BACK`; `anew`: no clock has told the time since."""
    attach = {"m": [A, B], "n": [MODE]} if others else {"m": [A, B]}
    streams = [replace(s, latency=0) for s in STREAMS]
    session = open_session([LIVES], attach=attach, streams=streams, maker=native, max_delay=50, max_skew=10_000)
    if simulated:
        session.simulate()
    feed = Feed(session)
    feed.clock(A, 10, 10)
    feed(B, 10)
    if others:
        feed.clock(MODE, 10, 10, monitor="n")
    feed.clock(A, 11, 11)
    assert session.judges["publication"].counters.steps == 1
    if anew:
        session.simulate()
    for monitor in attach:
        session.returning.expect(monitor)
    for monitor, observed in attach.items():
        session.returning.came(monitor, BACK)
        session.attach(monitor, observed, BACK)
    return session, feed


@SIM
@pytest.mark.parametrize("pause", [1, 40, 900])
def test_deadlines_do_not_overtake_what_was_kept_however_long_it_takes(simulated: bool, pause: int) -> None:
    _, feed = returned(simulated)
    judged, now = [], BACK
    for stamp in range(60, 1_060, 50):
        now += pause
        judged += feed(B, stamp, arrived=now)
    judged += feed.clock(A, 1_050, now) + feed.clock(B, 1_050, now)
    assert {kind for kind, _, _ in told(judged)} == {"topic"}
    judged = feed.clock(A, now, now) + feed.clock(B, now, now)
    assert told(judged)[-1] == ("tick", 1_111, "currently_false"), "once all has been told there is nothing to wait for"


def test_what_one_still_has_is_waited_for_while_others_are_level() -> None:
    session, feed = returned(False, others=True)
    feed.clock(MODE, BACK, BACK, monitor="n")
    now = BACK
    for stamp in range(60, 1_060, 50):
        now += 60
        feed.clock(MODE, now, now, monitor="n")
        judged = feed(B, stamp, arrived=now) + session.advance(now + 59)
        assert all(kind == "topic" for kind, _, _ in told(judged))


@pytest.mark.parametrize("first", ["event", "clock"])
def test_an_event_before_any_clock_of_a_simulation_tells_how_far_its_monitor_is(first: str) -> None:
    session, feed = returned(True, others=True, anew=True)
    judged = feed(B, 60, arrived=BACK) if first == "event" else []
    now = BACK + 1
    feed.clock(MODE, 2_000, now, monitor="n")
    for stamp in range(60 if first == "clock" else 110, 1_060, 50):
        now += 60
        judged += session.advance(now - 1) + feed(B, stamp, arrived=now)
    assert {kind for kind, _, _ in told(judged)} == {"topic"}


@SIM
def test_one_that_says_no_more_is_not_waited_for(simulated: bool) -> None:
    session, feed = returned(simulated, others=True)
    feed.clock(MODE, BACK, BACK, monitor="n")
    assert session.next_deadline == BACK + SILENT
    assert told(session.advance(BACK + SILENT - 1)) == []
    assert told(session.advance(BACK + SILENT)) == [("tick", 111, "currently_false")]


def test_nor_is_one_that_never_gets_level() -> None:
    session, feed = returned(False)
    now, stamp, judged = BACK, 60, list[tuple[str, int, str]]()
    while not judged:
        now, stamp = now + SILENT // 2, stamp + 1
        judged = [row for row in told(feed(B, stamp, arrived=now)) if row[0] == "tick"]
    assert now == BACK + MOST
    assert session.next_deadline is not None


def test_one_whose_events_have_no_times_is_as_far_as_they_come() -> None:
    session, feed = returned(False)
    feed(B, None, arrived=BACK + 40)
    assert session.next_deadline == BACK + 50
    assert ("tick", 111, "currently_false") in told(session.advance(BACK + 50))


def test_all_are_awaited_and_of_those_that_are_back_the_one_that_is_least_far_counts() -> None:
    returning = Returning()
    for monitor in ("m", "n"):
        returning.expect(monitor)
    since = []
    for now, monitor in ((10, "m"), (20, "n")):
        returning.came(monitor, now)
        since.append(returning.since)
    assert since == [None, 20], "one is away still when the other comes"
    returning.hear("m", 5, 21)
    assert returning.told(21) == 0, "the other one has told nothing"
    returning.hear("n", 7, 22)
    returning.hear("m", 3, 23)
    returning.came("m", 24)
    assert (returning.since, returning.told(24)) == (20, 5), "neither a clock that is behind nor a reconnect undoes it"
    returning.hear("n", None, 30)
    assert returning.until(30) == 23 + SILENT
    assert returning.told(23 + SILENT) == 7
    assert returning.until(23 + SILENT) == 30 + SILENT
    returning.left("n", 40)
    assert (returning.told(40), returning.until(40), bool(returning)) == (None, 40, False)


def test_one_that_tells_of_no_time_is_waited_for_once_it_does() -> None:
    returning = Returning()
    for monitor in ("m", "n"):
        returning.expect(monitor)
    for monitor in ("m", "n"):
        returning.came(monitor, 10)
        returning.hear(monitor, None, 11)
    assert returning.told(11) is None
    returning.hear("n", 9, 12)
    assert returning.told(12) == 9
    returning.hear("m", 4, 13)
    assert returning.told(13) == 4
