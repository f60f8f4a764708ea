"""Elements of a message as steps of their own: judged as if each had been an event."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Any, Literal, NamedTuple
from unittest.mock import patch

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.asking import Ask
from oracle_server.core.engine import Answer, Engine
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.revise import lateness
from oracle_server.core.revisions import Revision
from oracle_server.core.session import Session
from oracle_server.core.signals import RowProjection
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import Judged, Outcome, record
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.table import make_engine
from tests.core.sessions import MAX_DELAY, open_session, prop
from tests.core.test_asking import external

often = settings(max_examples=300, deadline=None, database=None)
Late = Literal["judge", "skip", "revise"]
TF, OTHER = StreamKey("/tf", "topic"), StreamKey("/other", "topic")
ANSWER = Answer(Outcome.CURRENTLY_TRUE, "it is so")
PROPERTIES = [
    prop("once_before", "forall[k]. {k: *k, v: 1} -> pre once {k: *k}"),
    prop("soon", '{topic: "/other"} -> once[:6ns] {v: 2}', time="seconds"),
    prop("never_twice", "historically not ({v: 3} and pre {v: 3})"),
    prop("awaited", "{v: 0} -> eventually[:5ns] {v: 1}", time="seconds"),
]


class Sent(NamedTuple):
    """A message of so many elements, or without a list, so long (ns) after the last one, and so long on its way."""

    other: bool
    items: list[tuple[str, int]]
    after: int
    delay: int


sent = st.builds(
    Sent,
    st.booleans(),
    st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 3)), max_size=4),
    st.integers(0, 4),
    st.sampled_from([0, 0, 1, 5, 60, 200]),
)


def made(property_: Property) -> Engine:
    return make_engine(property_) if property_.external else NativeEngine(property_.formula, property_.time)


def course(
    script: Sequence[Sent],
    late: Late,
    by: str,
    *,
    rows: bool,
    enough: Callable[[], bool] | None = None,
    asked: bool = False,
    horizon: int = 500,
    busy: bool = False,
) -> list[Judged]:
    """What is judged of messages with rows, or of an event for each element.

    `asked`: an oracle is, of others; `busy`: the server looks at the time only when a message comes.
    """
    signals = {"k": "item.k", "v": "item.v"} if rows else {"k": "msg.k", "v": "msg.v"}
    streams = (StreamSpec("/tf", signals=signals, each="msg.list" if rows else None), StreamSpec("/other", signals={}))
    told_again = any(one.delay > MAX_DELAY for one in script)
    """Deadlines are, between one late event and the next, and not between two rows."""
    properties = [p for p in PROPERTIES if p.time == "steps"] if told_again else PROPERTIES
    if asked:
        properties = [*properties, external("theirs", "/other")]
    session = open_session(
        properties, attach={"m": [TF], "n": [OTHER]}, streams=streams, maker=made, late=late, by=by, horizon=horizon
    )
    waiting = deque[Ask]()
    if enough is not None:
        session.divide(enough)
    seqs, judged, stamp = {"m": 0, "n": 0}, list[Judged](), 1000
    coming = []
    for one in script:
        stamp += one.after
        coming.append((stamp + one.delay, stamp, one))
    for arrived, stamped, one in sorted(coming, key=lambda each: each[0]):
        key, monitor = (OTHER, "n") if one.other else (TF, "m")
        items = [{"k": k, "v": v} for k, v in one.items]
        data: list[Any] = [{"list": items}] if rows or one.other else items or [{}]
        judged += session.advance(arrived) if busy else until(session, arrived)
        for each in data:
            seqs[monitor] += 1
            judged += session.ingest(Event(key, monitor, seqs[monitor], stamped, arrived, each))
        waiting.extend(session.take_asks())
        while waiting and (one.after % 2 or len(waiting) > 2):
            judged += session.resolve(waiting.popleft(), ANSWER, arrived)
    end = 10**9
    judged += session.finish(end)
    for ask in (*waiting, *session.take_asks()):
        judged += session.resolve(ask, ANSWER, end)
    return judged + session.end(end)


def until(session: Session, now: int) -> list[Judged]:
    """What a session does of itself up to a time, piece by piece."""
    judged, last = [], -1
    while (due := session.next_deadline) is not None and due <= now:
        if due <= last and not session.has_due and not session.is_behind:
            break
        judged += session.advance(due)
        last = due
    return judged


def told(judged: Sequence[Judged]) -> list[Any]:
    """What was said, but for the numbers that an event has of its monitor, and how many late events there were."""
    found: list[Any] = []
    for item in judged:
        if isinstance(item, Revision):
            changes = [None if c is None else (c.first, c.last, c.n, c.outcome, c.violation) for c in item.changes]
            found.append((item.step.stamp, changes))
            continue
        step, verdicts = item.step, [(v.n, v.outcome, v.degraded, v.explanation is not None) for v in item.verdicts]
        found.append((item.number, item.place, step.event.stream, step.stamp, step.late, step.signals, verdicts))
    return found


@often
@given(
    st.lists(sent, max_size=12),
    st.sampled_from(["judge", "skip", "revise"]),
    st.sampled_from(["publication", "arrival", "both"]),
    st.booleans(),
)
def test_rows_are_judged_as_events_of_their_own(script: list[Sent], late: Late, by: str, divided: bool) -> None:
    by = "publication" if late == "revise" else by
    if late == "revise" and any(one.delay > MAX_DELAY for one in script):
        divided = False  # which late events share a pass goes by when they come, and changes nothing that stands
    enough = (lambda: True) if divided else None
    apart, mine = (course(script, late, by, rows=rows, enough=enough) for rows in (False, True))
    orders = ("publication", "arrival") if by == "both" else (by,)
    for order in orders:
        one, other = ([j for j in judged if j.order == order] for judged in (mine, apart))
        if by == "both":  # numbers of verdicts go over both orders, which take turns by event
            one, other = ([unnumbered(j) for j in found] for found in (one, other))
        assert told(one) == told(other)


@often
@given(
    st.lists(sent, max_size=12),
    st.sampled_from(["judge", "skip"]),
    st.sampled_from(["publication", "arrival"]),
    st.booleans(),
)
def test_they_are_beside_what_an_oracle_elsewhere_is_asked(
    script: list[Sent], late: Late, by: str, divided: bool
) -> None:
    enough = (lambda: True) if divided else None
    apart, mine = (course(script, late, by, rows=rows, enough=enough, asked=True) for rows in (False, True))
    assert told(mine) == told(apart)


def sparse(one: Sent, factor: int) -> Sent:
    """Sent so many times as long after the last one."""
    return one._replace(after=one.after * factor)


@often
@given(
    st.lists(st.builds(sparse, sent, st.sampled_from([1, 20])), max_size=12),
    st.sampled_from(["judge", "skip", "revise"]),
    st.sampled_from(["publication", "arrival"]),
    st.sampled_from([3, 80, 500]),
    st.randoms(use_true_random=False),
)
def test_however_divided_nothing_is_judged_between_two_rows_of_an_event(
    script: list[Sent], late: Late, by: str, horizon: int, rng: random.Random
) -> None:
    """Not even what comes too late to be put in its place."""
    by = "publication" if late == "revise" else by
    with patch.object(lateness, "TOGETHER", 20):
        judged = course(script, late, by, rows=True, enough=lambda: rng.random() < 0.6, horizon=horizon, busy=True)
    steps = [j.step.event for j in judged if not isinstance(j, Revision) and j.step.event.monitor and j.place is None]
    messages = [len(list(rows)) for _, rows in groupby(steps, key=lambda event: (event.monitor, event.seq))]
    seqs = [(event.monitor, event.seq) for event in steps if not event.more]
    assert len(messages) == len(seqs) == len(set(seqs))


def unnumbered(judged: Judged) -> Judged:
    """Without the numbers of its verdicts."""
    verdicts = tuple([msgspec.structs.replace(v, n=0) for v in judged.verdicts])
    return msgspec.structs.replace(judged, verdicts=verdicts)


def test_a_record_says_which_row_it_is_of() -> None:
    judged = course([Sent(False, [("a", 3), ("a", 3)], 1, 0)], "judge", "arrival", rows=True)
    records = [record(j, j.verdicts[2]) for j in judged if j.step.event.monitor]
    assert [(r["step"], r["seq"], r.get("row"), r["violation"]) for r in records] == [(1, 1, 0, False), (2, 1, 1, True)]
    explanation = records[1]["explanation"]
    assert explanation is not None
    assert "/tf (topic 1 of m, row 1)" in explanation["text"]
    assert explanation["event"]["row"] == 1


def test_an_event_without_rows_is_one_step_without_their_signals() -> None:
    project = RowProjection({"k": "item.k"}, "msg.list")
    messages: list[dict[str, Any]] = [{}, {"list": []}, {"list": None}]
    for message in messages:
        assert not project.rows(message)
        assert project(message) == ({}, frozenset())
    (only,) = [j for j in course([Sent(False, [], 1, 0)], "judge", "arrival", rows=True) if j.number]
    assert "row" not in record(only, only.verdicts[0])


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ({"list": "abc"}, "`each` is 'abc', and rows are the elements of a list"),
        ({"list": {"a": 1}}, "`each` is a message, and rows are the elements of a list"),
        ({"list": [{}] * 257}, "`each` has 257 elements, and a message may have 256 rows"),
    ],
)
def test_what_can_not_be_divided_is_unknown_and_says_why(message: Any, reason: str) -> None:
    project = RowProjection({"k": "item.k", "v": "index"}, "msg.list")
    assert not project.rows(message)
    assert project(message) == ({}, frozenset({"k", "v"}))
    assert project.reasons(message) == {"k": reason, "v": reason}


@pytest.mark.parametrize(
    ("each", "lacks"),
    [
        ("msg.list.filter(x, x.ok)", "x.ok"),
        ("msg.list.filter(x, x.of.ok)", "x.of"),
        ("msg.list.map(x, x.ok, x.of)", "x.ok"),
        ("msg.list.map(x, x.ok).filter(y, y)", "x.ok"),
    ],
)
def test_a_message_is_not_let_go_for_what_an_element_lacks(each: str, lacks: str) -> None:
    project = RowProjection({"k": "item.k"}, each)
    message: dict[str, Any] = {"list": [{"k": "bad", "ok": True, "of": {"ok": True}}, {"k": "b"}]}
    assert not project.rows(message)
    assert project(message) == ({}, frozenset("k"))
    assert project.reasons(message) == {"k": f"`each`: {lacks} is absent at an element"}
    blank: list[dict[str, Any]] = [{}, {"list": None}, {"list": []}]
    for none in blank:
        assert project(none) == ({}, frozenset())


def test_an_element_that_fails_is_unknown_alone() -> None:
    project = RowProjection({"k": "item.k + 1", "i": "index"}, "msg.list")
    message = {"list": [{"k": 1}, {"k": "x"}, {}, 7]}
    assert project.rows(message) == [
        ({"k": 2, "i": 0}, frozenset()),
        ({"i": 1}, frozenset({"k"})),
        ({"i": 2}, frozenset()),
        ({"i": 3}, frozenset({"k"})),
    ]
    assert project.reasons(message)["k"].startswith("row 1: item.k is 'x'")


def test_all_rows_of_an_event_share_one_bound() -> None:
    """A message of 256 rows costs no more than one that is judged whole may."""
    project = RowProjection({"n": "size(msg.big.filter(x, x > item.v))"}, "msg.list")
    few = {"list": [{"v": 1}], "big": [2] * 1000}
    many = {"list": [{"v": 1}] * 256, "big": [2] * 1000}
    assert project.rows(few) == [({"n": 1000}, frozenset())]
    assert all(failed == {"n"} for _, failed in project.rows(many))
    assert "costs more than" in project.reasons(many)["n"]


def test_a_late_event_counts_once() -> None:
    streams = (StreamSpec("/tf", signals={"k": "item.k"}, each="msg.list"), StreamSpec("/other", signals={}))
    for late in ("judge", "skip", "revise"):
        session = open_session(
            [PROPERTIES[0]], attach={"m": [TF], "n": [OTHER]}, streams=streams, maker=made, late=late, horizon=500
        )
        session.ingest(Event(OTHER, "n", 1, 1000, 1000, {}))
        session.advance(1000 + 2 * MAX_DELAY)
        session.ingest(Event(TF, "m", 1, 900, 1000 + 2 * MAX_DELAY, {"list": [{"k": "a"}] * 5}))
        session.finish(10**9)
        counters = session.judges["publication"].counters
        assert (session.counts["m", TF].late, counters.late) == (1, 1), late
        assert counters.skipped == (late == "skip")
        if session.lateness is not None:
            assert (session.lateness.placed, session.lateness.beyond) == (1, 0)
