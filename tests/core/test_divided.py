"""What the order releases at once may be judged piece by piece: in the same order, with the same outcomes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.session import Session
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Judged
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import MODE, A, B, Feed, U, open_session, prop

often = settings(max_examples=400, deadline=None, database=None)
ORDERED = (A, B, MODE)
PROPERTIES = [
    prop("answered", '{topic: "/a"} -> once[:3ns] {topic: "/b"}', time="seconds"),
    prop("awaited", 'once[4ns:] {topic: "/a"} -> once[:9ns] {mode: 1}', time="seconds"),
    prop("before", 'pre {topic: "/a"} -> {topic: "/b"}'),
]


class Move(NamedTuple):
    """An event of a stream, or its clock, so long (ns) after the stream's last one; then so many looks at the time."""

    stream: int
    clock: bool
    after: int
    mode: int
    looks: int


moves = st.lists(
    st.builds(Move, st.integers(0, 2), st.booleans(), st.integers(0, 12), st.integers(0, 1), st.integers(0, 3)),
    max_size=30,
)


def native(property_: Property) -> NativeEngine:
    return NativeEngine(property_.formula, property_.time)


def at_once() -> bool:
    """Enough is done after each step."""
    return True


def course(script: list[Move], enough: Callable[[], bool] | None, **ordering: Any) -> list[Judged]:
    """What is judged of a script in which monitors lag behind each other."""
    session = open_session(PROPERTIES, attach={"m": ORDERED}, maker=native, by="publication", **ordering)
    if enough is not None:
        session.divide(enough)
    feed, newest, now, judged = Feed(session), dict.fromkeys(ORDERED, 1), 1, list[Judged]()
    for move in script:
        stream, now = ORDERED[move.stream], now + 3
        newest[stream] += move.after
        if move.clock:
            judged += feed.clock(stream, newest[stream], now)
        else:
            judged += feed(stream, newest[stream], {"mode": move.mode} if stream == MODE else {}, arrived=now)
        for _ in range(move.looks):
            judged += session.advance(now)
    return judged + drained(session, now) + session.finish(now)


def drained(session: Session, now: int) -> list[Judged]:
    judged: list[Judged] = []
    while session.buffer.due is not None:
        assert session.next_deadline == session.now, "what is due is judged at once, and not at some deadline"
        found = session.advance(now)
        assert found
        judged += found
    return judged


def told(judged: list[Judged]) -> list[tuple[object, ...]]:
    return [
        (j.step.event.stream, j.step.stamp, j.step.event.seq, j.step.late, j.step.forced, j.number, j.verdicts)
        for j in judged
    ]


@often
@given(moves)
def test_in_pieces_all_is_judged_as_at_once(script: list[Move]) -> None:
    assert told(course(script, at_once, max_delay=None)) == told(course(script, None, max_delay=None))


@often
@given(moves, st.sampled_from([0, 5, 40]), st.sampled_from([2, 5, 10_000]))
def test_in_pieces_each_event_is_judged_once_in_order_whatever_the_bounds(
    script: list[Move], max_delay: int, capacity: int
) -> None:
    judged = course(script, at_once, max_delay=max_delay, capacity=capacity)
    events = [j for j in judged if j.step.event.monitor]
    assert sorted(j.step.event.seq for j in events) == list(range(1, sum(not move.clock for move in script) + 1))
    in_time = [j.step.time for j in events if not j.step.late]
    assert in_time == sorted(in_time)


def test_an_event_that_is_not_ordered_need_not_wait_for_what_is_due() -> None:
    session = open_session(PROPERTIES, attach={"m": [A, B]}, maker=native, by="publication", max_delay=None)
    session.divide(at_once)
    feed = Feed(session)
    for stamp in (2, 3, 4):
        feed(A, stamp, arrived=stamp)
    assert len(feed.clock(B, 9, 9)) == 1
    unordered = [j for j in feed(U, 9, arrived=10) if j.step.event.stream == U]
    assert len(unordered) == 1
    assert [j.step.stamp for j in drained(session, 11) if j.step.event.monitor] == [4]


def test_no_deadline_is_judged_before_an_older_event_that_is_due() -> None:
    answered = prop("p", 'once[5ns:] {topic: "/a"} -> once {topic: "/b"}', time="seconds")
    found = []
    for divided in (False, True):
        session = open_session([answered], attach={"m": ORDERED}, maker=native, by="publication", max_delay=50)
        if divided:
            session.divide(at_once)
        feed = Feed(session)
        for stream, stamp in ((A, 10), (A, 12), (A, 30), (B, 31), (A, 40)):
            assert feed(stream, stamp, arrived=stamp) == []
        judged = session.advance(500)
        assert len(judged) == (1 if divided else 6)
        found.append([(j.step.stamp, j.verdicts[0].outcome.value) for j in judged + drained(session, 500)])
    assert found[0] == found[1]
    assert [stamp for stamp, _ in found[0]] == [10, 12, 15, 30, 31, 40]


def test_at_the_end_all_is_judged_at_once_and_then_in_pieces_again() -> None:
    session = open_session(PROPERTIES, attach={"m": [A, B]}, maker=native, by="publication", max_delay=None)
    session.divide(at_once)
    feed = Feed(session)
    for last in (5, 10):
        for stamp in range(last - 4, last):
            feed(A, stamp, arrived=stamp)
        assert len([j for j in feed.clock(B, last, last) if j.step.event.monitor]) == 1
        if last == 5:
            assert [j.step.stamp for j in session.finish(5) if j.step.event.monitor] == [2, 3, 4]
            assert session.buffer.due is None
