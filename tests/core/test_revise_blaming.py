"""Guards that blame are of one mind, whether or not the session revises, as long as nothing comes late."""

from __future__ import annotations

import itertools
import json
import random
from dataclasses import replace
from typing import Any, Literal

import msgspec
import pytest

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.formula.parse import Time
from oracle_server.core.judging.deciding import is_denied
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Spec
from oracle_server.core.verdicts import Decision, Judged, Outcome
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from tests.core.revising import A, case
from tests.strategies import SECOND, START

Late = Literal["judge", "revise"]
CMD, SCAN = (StreamKey(name, "topic") for name in ("/cmd", "/scan"))
NEAR = """
id: s
ordering: {%s, max_delay: 100ms}
streams:
  - {topic: /cmd, action: filter, on_deny: %s, signals: {v: msg.v}}
  - {topic: /scan, signals: {near: 'msg.d < 0.5'}, hold: [near]}
properties:
  - {id: clear, formula: '{near: false}', latch: true, guards: [/cmd], blame: caused}
"""
LIMIT = """
id: s
ordering: {%s, max_delay: 100ms}
streams:
  - {topic: /cmd, action: filter, signals: {v: msg.v}}
properties:
  - {id: slow, formula: '{topic: /cmd} -> {v <= 5}', latch: true, guards: [/cmd], blame: caused}
"""
ORDERING: dict[Late, str] = {"judge": "late: judge", "revise": "late: revise, horizon: 2s"}


def session_of(text: str) -> Session:
    ready = plan(parse_spec(text, "s.yaml").spec)
    session = Session(ready, make_engines(ready))
    session.attach("m", ready.spec.by_key, START)
    return session


def fed(session: Session, events: list[tuple[StreamKey, dict[str, object]]], first: int = 1) -> list[str]:
    """The decisions on events that come in order, one a second."""
    judged: list[Judged] = []
    for n, (key, data) in enumerate(events, first):
        at = START + n * SECOND
        judged += session.ingest(Event(key, "m", n, at, at, data, ask=key == CMD))
        judged += session.advance(at + SECOND // 2)
    return [row.decision.choice for row in judged if row.decision]


@pytest.mark.parametrize("on_deny", ["keep", "undo"])
@pytest.mark.parametrize("late", ["judge", "revise"])
def test_a_latched_guard_that_can_not_be_told_denies(late: Late, on_deny: str) -> None:
    near: dict[str, object] = {"d": 0.1}
    far: dict[str, object] = {"d": 9.0}
    lost: dict[str, object] = {"d": "NaN"}
    go: dict[str, object] = {"v": 1}
    events = [(SCAN, far), (CMD, go), (SCAN, near), (CMD, go), (SCAN, lost), (CMD, go), (SCAN, far), (CMD, go)]
    assert fed(session_of(NEAR % (ORDERING[late], on_deny)), events) == ["allow", "allow", "deny", "allow"]


@pytest.mark.parametrize("restart", ["no restart", "restart", "restart of an older version"])
@pytest.mark.parametrize("late", ["judge", "revise"])
def test_one_denied_event_does_not_deny_all_that_are_innocent(late: Late, restart: str) -> None:
    slow: dict[str, object] = {"v": 1}
    fast: dict[str, object] = {"v": 9}
    session = session_of(LIMIT % ORDERING[late])
    assert fed(session, [(CMD, v) for v in (slow, fast, slow, slow, slow)]) == ["allow", "deny", *["allow"] * 3]
    then = ["deny", "allow"]
    if restart != "no restart":
        saved: Any = json.loads(json.dumps(session.snapshot()))
        session = session_of(LIMIT % ORDERING[late])
        if restart != "restart" and late == "revise":
            del saved["revising"]["beneath"]
            then = ["deny", "deny"]
        session.restore(saved, 6)
    assert fed(session, [(CMD, fast), (CMD, slow)], 6) == then


def decided(spec: Spec, events: list[Event], late: Late) -> list[tuple[str, int, Decision | None, list[Outcome]]]:
    spec = replace(spec, ordering=replace(spec.ordering, late=late, horizon=3 * SECOND))
    engines = [[NativeEngine(p.formula, p.time) for p in spec.properties]]
    session = Session(plan(spec), engines, begun=START)
    for monitor in "mn":
        session.attach(monitor, spec.by_key, START)
    judged: list[Judged] = []
    for event in events:
        while (deadline := session.next_deadline) is not None and deadline <= event.arrived:
            judged += session.advance(max(deadline, session.now))
        judged += session.ingest(event)
        while session.release():
            judged += session.advance(session.now)
    return [
        (row.step.event.monitor, row.step.event.seq, row.decision, [v.outcome.current for v in row.verdicts])
        for row in judged
        if row.step.event.monitor
    ]


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_where_nothing_is_late_revising_decides_no_otherwise(time: Time) -> None:
    denied = 0
    for number in range(300):
        rng = random.Random(f"{time}{number}")
        spec, events = case(rng, time)
        properties = [replace(p, latch=True, blame="caused", guards=frozenset({"/a"})) for p in spec.properties]
        streams = [replace(s, action="filter") if s.key == A else s for s in spec.streams]
        spec = replace(spec, properties=tuple(properties), streams=tuple(streams))
        seqs = {monitor: itertools.count(1) for monitor in "mn"}
        in_order = [
            msgspec.structs.replace(e, arrived=e.stamp or 0, seq=next(seqs[e.monitor]), ask=e.stream == A)
            for e in sorted(events, key=lambda e: e.stamp or 0)
        ]
        revised = decided(spec, in_order, "revise")
        assert revised == decided(spec, in_order, "judge"), number
        denied += any(is_denied(row[2]) for row in revised)
    assert denied > 10, "else this shows little"
