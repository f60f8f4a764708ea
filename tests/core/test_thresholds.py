"""The numbers that formulas compare signals with, by the streams that have these."""

from __future__ import annotations

from oracle_server.core.thresholds import thresholds
from oracle_server.specfiles.load import parse_spec

SPEC = """
id: base
streams:
  - {topic: /cmd, signals: {v: msg.v}}
  - {topic: /odom, signals: {v: msg.twist, s: msg.s}}
  - {topic: /raw}
properties:
  - {id: slow, formula: 'historically {topic: /cmd, v <= 1.5}'}
  - {id: same, formula: '{v > 2} or {v > 2} or {s: true} or {s < v} or {topic: /raw, data >= -1}'}
"""


def test_a_number_stands_at_each_stream_that_the_atom_may_be_of() -> None:
    found = thresholds(parse_spec(SPEC, "base.yaml").spec)
    assert [(str(t.stream), t.signal, t.property, t.op, t.value) for t in found] == [
        ("/cmd", "v", "slow", "<=", 1.5),
        ("/cmd", "v", "same", ">", 2),
        ("/odom", "v", "same", ">", 2),
        ("/raw", "v", "same", ">", 2),
        ("/raw", "data", "same", ">=", -1),
    ]
