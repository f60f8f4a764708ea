"""Deadlines of several keys at one time, of which a server that was killed had told some: the others are told then."""

from __future__ import annotations

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

MS, S = 10**6, 10**9
T0 = 1_000 * S
ALIVE = StreamKey("/alive", "topic")
SPEC = """
id: silences
streams:
  - {topic: /alive, each: msg.nodes, signals: {node: item}}
ordering: {max_delay: 50ms}
derive:
  silent: {age: '{topic: /alive}', by: node, forget: 1h}
properties:
  - {id: a, formula: 'not {node: a, silent > 0.5}', time: seconds}
  - {id: b, formula: 'not {node: b, silent > 0.5}', time: seconds}
  - {id: c, formula: 'not {node: c, silent > 1.5}', time: seconds}
  - {id: every, formula: 'not {silent > 0.5} or once[:1s]{node: a}', time: seconds}
"""
READY = plan(parse_spec(SPEC, "silences").spec)


def begun() -> Session:
    session = Session(READY, make_engines(READY), begun=T0)
    session.divide(lambda: True)
    return session


def life(session: Session, since: int) -> list[Judged]:
    """What comes of it from a time on, in turns."""
    judged: list[Judged] = []
    for at in range(since, T0 + 4 * S, 100 * MS):
        judged += session.advance(at)
        while (due := session.next_deadline) is not None and due <= at:
            judged += session.advance(at)
    return judged


def told(rows: list[Judged]) -> list[tuple[int, object, list[str]]]:
    return [(row.step.stamp - T0, row.step.signals.get("node"), [v.outcome for v in row.verdicts]) for row in rows]


def test_wherever_it_is_killed_all_deadlines_are_told() -> None:
    session = begun()
    rows = session.attach("m", [ALIVE], T0)
    for seq, nodes in ((1, ["c", "b"]), (2, ["a", "b", "c"])):
        rows += session.ingest(Event(ALIVE, "m", seq, T0 + seq * MS, T0 + seq * MS, {"nodes": nodes}))
        while session.rows:
            rows += session.advance(T0 + seq * MS)
    assert len(rows) == 5
    whole = rows + life(session, T0 + 100 * MS)
    together = [row for row in whole if row.step.stamp == T0 + 2 * MS + 500 * MS + 1]
    assert len(together) > 1, "several keys turn at one time"
    for kept in range(5, len(whole) + 1):
        again = begun()
        for row in whole[:kept]:
            again.rejudge("publication", row.step, row.judged)
        assert again.can_be_saved is not again.judges["publication"].is_ticking
        now = max(row.judged for row in whole[:kept])
        found = whole[:kept] + again.attach("m", [ALIVE], now) + life(again, now)
        assert told(found) == told(whole), f"killed behind row {kept}"


def test_no_snapshot_is_taken_while_some_of_them_wait() -> None:
    session = begun()
    session.attach("m", [ALIVE], T0)
    session.ingest(Event(ALIVE, "m", 1, T0, T0, {"nodes": ["a", "b"]}))
    while session.rows:
        session.advance(T0)
    waited = 0
    session.advance(T0 + 2 * S)
    while session.next_deadline == session.now:
        assert session.can_be_saved is not session.judges["publication"].is_ticking
        waited += not session.can_be_saved
        session.advance(session.now)
    assert waited
    assert session.can_be_saved
