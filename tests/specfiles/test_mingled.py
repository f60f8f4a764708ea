"""What `check` says of atoms that ask of one robot what is held of whichever came last."""

from __future__ import annotations

import pytest

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: fleet
ordering: {by: arrival}
streams:
  - {topic: /battery, signals: {robot: msg.robot, level: msg.level}}
  - {topic: /dock, signals: {robot: msg.robot, docked: msg.docked}, hold: HOLD}
  - {topic: /clock, signals: {hour: msg.data}}
derive:
  last_docked: {last: docked, by: robot, forget: 1h}
properties:
  - {id: p, PROPERTY}
"""
LOW = "forall[r]. {topic: /battery, robot: *r, level < 20}"


def told(prop: str, hold: str = "[docked]") -> list[str]:
    found = parse_spec(SPEC.replace("HOLD", hold).replace("PROPERTY", prop), "s.yaml").warnings
    return [each.message for each in found if "whatever its" in each.message]


@pytest.mark.parametrize(
    ("prop", "hold", "is_told"),
    [
        (f"formula: '{LOW} -> {{robot: *r, docked}}'", "[docked]", True),
        (f"formula: '{LOW} -> {{robot: *r, docked}}'", "[docked, robot]", True),
        ("pattern: 'forall[r]. no {topic: /battery, robot: *r, docked: false}'", "[docked]", True),
        (f"formula: '{LOW} -> {{robot: *r, last_docked}}'", "[docked]", False),
        (f"formula: '{LOW} -> once {{topic: /dock, robot: *r, docked}}'", "[docked]", False),
        ("formula: 'forall[r]. {topic: /clock, robot: *r} -> {robot: *r, docked}'", "[docked, robot]", False),
        ("formula: 'forall[r]. not {topic: /clock, robot: *r, docked}'", "[docked, robot]", False),
        ("formula: 'not {topic: /battery, robot: r1, docked}'", "[docked]", False),  # as `mode: AUTO` may be
    ],
)
def test_what_is_held_of_another_key_is_told_of(prop: str, hold: str, *, is_told: bool) -> None:
    found = told(prop, hold)
    assert len(found) == is_told
    for each in found:
        assert "at an event of /battery `docked` is that of the last message of /dock, whatever its `robot` was" in each
        assert each.endswith("{last: docked, by: robot, forget: 1h}` under `derive`, and ask for `last_docked`")


@pytest.mark.parametrize(("signal", "outcome"), [("docked", "currently_true"), ("last_docked", "currently_false")])
def test_the_mend_tells_robots_apart(signal: str, outcome: str) -> None:
    text = SPEC.replace("HOLD", "[docked]").replace("PROPERTY", f"formula: '{LOW} -> {{robot: *r, {signal}}}'")
    ready = plan(parse_spec(text, "s.yaml").spec)
    session = Session(ready, [make_engines(ready)[0]], begun=0)
    session.ingest(Event(StreamKey("/dock", "topic"), "m", 1, 1, 1, {"robot": "r2", "docked": True}))
    judged = session.ingest(Event(StreamKey("/battery", "topic"), "m", 2, 2, 2, {"robot": "r1", "level": 5}))
    assert [j.verdicts[0].outcome.value for j in judged] == [outcome]
