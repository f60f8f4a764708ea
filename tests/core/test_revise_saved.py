"""A session that revises and is saved, or restored, at an odd moment: it says what it had said otherwise."""

from __future__ import annotations

import json

import pytest

from oracle_server.core.bypass import Bypass
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Verdict
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from tests.core.revising import Book

MS, S = 10**6, 10**9
T0 = 1_000 * S
A, U = StreamKey("/a", "topic"), StreamKey("/u", "topic")

ONE = """
id: one
streams: [{topic: /a, signals: {v: msg.v}}]
ordering: {late: revise, horizon: 10s, max_delay: 50ms}
properties: [{id: p, formula: 'historically not {v: 1}'}]
"""
MANY_DEADLINES = """
id: many
streams:
  - {topic: /a, signals: {v: msg.v, b: msg.b}}
  - {topic: /u, signals: {u: msg.u, w: msg.w}, ordered: false}
ordering: {late: revise, horizon: 60s, max_delay: 1s}
properties:
  - {id: asks, formula: 'once[2s:]{b: 1} -> once {u: 1}', time: seconds}
  - {id: many, formula: 'forall[x]. {w: *x} -> once[:1s]{v: *x}', time: seconds}
"""

FIRST_WITHOUT_ORDER = """
id: first
streams: [{topic: /a}, {topic: /u, ordered: false}]
ordering: {late: revise, horizon: 10s, max_delay: 50ms}
properties: [{id: p, formula: 'once[1s:] {topic: /a}', time: seconds}]
"""


def session_of(text: str, begun: int | None = None) -> Session:
    ready = plan(parse_spec(text, "spec").spec)
    return Session(ready, make_engines(ready), begun=begun)


def restored(text: str, session: Session, book: Book, *, saved: bool) -> Session:
    """The session of another process, by a snapshot or by its rows alone."""
    again, position = session_of(text, session.begun), 0
    if saved:
        data = session.snapshot()
        assert data is not None
        position = data["revising"]["position"]
        again.restore(json.loads(json.dumps(data)), position * book.width + 1)
    for at in range(position + 1, len(book.rows) + 1):
        row = book.rows[at]
        judge = again.judges["publication"]
        if any(v.degraded and not v.bypassed for v in row.verdicts):
            judge.degrade()
        judge.bypass([i for i, v in enumerate(row.verdicts) if v.bypassed])
        again.rejudge_row(row, at)
    again.finish_again()
    again.judges["publication"].bypass(())
    return again


@pytest.mark.parametrize("saves", [False, True])
def test_a_snapshot_as_it_is_closed_takes_nothing_back_of_what_is_final(saves: bool) -> None:
    session = session_of(ONE)
    session.attach("m", [A], T0)
    for seq in range(1, 6):
        session.ingest(Event(A, "m", seq, T0 + seq, T0 + seq, {"v": int(seq == 3)}))
    session.finish(T0 + 100)
    if saves:
        assert session.snapshot() is not None
    assert [[v.outcome for v in row.verdicts] for row in session.end(T0 + 100)] == [["false"]]


@pytest.mark.parametrize("saved", [None, False, True])
@pytest.mark.parametrize("what", ["an event is refused", "a bypass has ended"])
def test_what_is_degraded_is_so_behind_a_restart_and_nothing_else(what: str, saved: bool | None) -> None:
    """Where nothing was judged since an event was refused, the snapshot alone knows of it."""
    session, book = session_of(ONE), Book(1)
    book.take(session.attach("m", [A], T0))
    if what == "a bypass has ended":
        session.bypass("m", {A: Bypass("somebody publishes past it", T0)})
    for seq in range(1, 4):
        book.take(session.ingest(Event(A, "m", seq, T0 + seq, T0 + seq, {"v": 0})))
    if what == "a bypass has ended":
        session.bypass("m", {})
    else:
        session.note_loss()
    if saved is not None:
        session = restored(ONE, session, book, saved=saved)
        if not saved and what != "a bypass has ended":
            session.note_loss()  # as a server that reads of the refusal
        book.take(session.attach("m", [A], T0 + 10))
    book.take(session.ingest(Event(A, "n", 1, T0 + 100, T0 + 100, {"v": 0})))
    book.take(session.finish(T0 + S))
    last: Verdict = book.first[max(book.first)].verdicts[0]
    assert (last.degraded, last.bypassed) == (what == "an event is refused", False)


@pytest.mark.parametrize("restarts", [False, True])
@pytest.mark.parametrize("awaited", [False, True])
def test_a_step_without_order_stands_behind_many_deadlines_whoever_is_awaited(awaited: bool, restarts: bool) -> None:
    session, book = session_of(MANY_DEADLINES), Book(2)
    book.take(session.attach("m", [A], T0))
    for seq in range(1, 21):
        at = T0 + seq * MS
        book.take(session.ingest(Event(A, "m", seq, at, at, {"v": seq, "b": int(seq == 20)})))
    if awaited:
        session.returning.expect("n")  # as after a restart, while another monitor is not back
    book.take(session.ingest(Event(U, "m2", 1, T0 + 10 * S, T0 + 10 * S, {"u": 1})))
    if restarts:
        session = restored(MANY_DEADLINES, session, book, saved=False)
    else:
        session.returning.left("n", T0 + 10 * S)
    book.take(session.attach("m", [A], T0 + 11 * S))
    for second in range(12, 20):
        book.take(session.advance(T0 + second * S))
    book.take(session.finish(T0 + 20 * S))
    said = {row.step.event.stream: book.stands(at).outcomes[0] for at, row in book.first.items()}
    ticks = [row.step.stamp - T0 for row in book.first.values() if not row.step.event.monitor]
    assert ticks == [2 * S + 20 * MS], "once what was 2 s ago is asked of, and nobody has said so yet"
    assert said[U] == "currently_true"


@pytest.mark.parametrize("saved", [False, True])
def test_a_first_step_without_order_stays_at_its_time_where_a_late_one_before_it_is_kept_no_more(saved: bool) -> None:
    session, book = session_of(FIRST_WITHOUT_ORDER, T0), Book(1)
    book.take(session.attach("m", [A], T0))
    book.take(session.ingest(Event(U, "n", 1, T0 + 3 * S, T0 + 3 * S, {})))
    book.take(session.ingest(Event(A, "m", 1, T0 + S, T0 + 4 * S, {})))
    book.take(session.ingest(Event(A, "m", 2, T0 + 12 * S, T0 + 12 * S, {})))
    book.take(session.finish(T0 + 12 * S))
    assert [book.stands(at).outcomes[0] for at in book.first] == ["currently_true", "currently_false", "currently_true"]
    again = restored(FIRST_WITHOUT_ORDER, session, book, saved=saved)
    book.take(again.attach("m", [A], T0 + 13 * S))
    book.take(again.finish(T0 + 13 * S))
    assert [row.step.event.monitor for row in book.first.values()] == ["n", "m", "m"], "no deadline was before it"
