"""The numbers that formulas compare signals with, by the streams that have these."""

from __future__ import annotations

from oracle_server.core.thresholds import MOST, thresholds
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


def test_of_formulas_that_may_be_of_hundreds_of_streams_the_first_ones_are_told() -> None:
    """Such a spec's document had 22 MB, and no decision was made for a second while it was written."""
    text = "id: many\nstreams:\n" + "".join([f"  - {{topic: /t{i}, signals: {{v: msg.v}}}}\n" for i in range(300)])
    text += "properties:\n" + "".join([f"  - {{id: p{i}, formula: 'not {{v > {i}}}'}}\n" for i in range(100)])
    found = thresholds(parse_spec(text, "many.yaml").spec)
    assert len(found) == MOST
    assert [(str(t.stream), t.property, t.value) for t in (found[0], found[300])] == [
        ("/t0", "p0", 0),
        ("/t0", "p1", 1),
    ]
