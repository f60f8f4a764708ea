"""What `check` says of rows that are held: other streams' events see the last one alone."""

from __future__ import annotations

import pytest

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: robot
ordering: {by: arrival}
streams:
  - {topic: /diagnostics, each: EACH, signals: {name: item.name, bad: SIGNAL}, HOLD}
  - {topic: /cmd_vel, signals: {speed: msg.linear.x}}
properties:
  - {id: p, formula: '{topic: /cmd_vel, speed > 0} -> not {bad}'}
"""
ANY = "'msg.status.exists(r, r.level > 1)'"


def spec(each: str, signal: str, hold: str = "hold: [bad]") -> str:
    return SPEC.replace("EACH", each).replace("SIGNAL", signal).replace("HOLD", hold)


@pytest.mark.parametrize(
    ("each", "signal", "hold", "is_told"),
    [
        ("msg.status", "item.level > 1", "hold: [bad]", True),
        ("msg.status", "'msg.status[index].level > 1'", "hold: [bad]", True),
        ("msg.status", ANY, "hold: [bad]", False),
        ("\"msg.status.filter(r, r.name == 'arm')\"", "item.level > 1", "hold: [bad]", False),
        ("msg.status", "item.level > 1", "hold: []", False),
    ],
)
def test_that_the_last_row_alone_is_held_is_told(each: str, signal: str, hold: str, *, is_told: bool) -> None:
    found = [w for w in parse_spec(spec(each, signal, hold), "s.yaml").warnings if "of the last row of" in w.message]
    assert len(found) == is_told
    for problem in found:
        assert problem.line == 4
        assert "as in `any: msg.status.exists(r, …)` under `signals`" in problem.message


@pytest.mark.parametrize(("signal", "outcome"), [("item.level > 1", "currently_true"), (ANY, "currently_false")])
def test_the_mend_sees_all_rows(signal: str, outcome: str) -> None:
    ready = plan(parse_spec(spec("msg.status", signal), "s.yaml").spec)
    session = Session(ready, [make_engines(ready)[0]], begun=0)
    rows = {"status": [{"name": "arm", "level": 2}, {"name": "base", "level": 0}]}
    session.ingest(Event(StreamKey("/diagnostics", "topic"), "m", 1, 1, 1, rows))
    judged = session.ingest(Event(StreamKey("/cmd_vel", "topic"), "m", 2, 2, 2, {"linear": {"x": 1.0}}))
    assert [verdict.outcome for each in judged for verdict in each.verdicts] == [outcome]
