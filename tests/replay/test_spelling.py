"""Texts that a spec spells otherwise than the recording: they are looked for at the streams whose events are asked."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.replay.judging import judge, write_spec

SPEC = """\
id: a
streams:
  - {topic: /a, signals: {state: msg.data}}
  - {topic: /b, signals: {state: msg.data}, hold: [HELD]}
  - {topic: /c, signals: {x: msg.x}}
properties:
  - {id: p, formula: 'FORMULA'}
"""


@pytest.mark.parametrize(
    ("formula", "held", "said"),
    [
        ("not {topic: /a, state: AUTO}", "", 'p compares state of /a with "AUTO", which it never was: it was "auto"'),
        ("not {topic: /a, state: AUTO} and not {topic: /b, state: AUTO}", "", "state of /a with"),
        ("not {topic: /a, state: auto} and not {topic: /b, state: AUTO}", "", None),
        ("not {state: AUTO}", "", None),
        ("not {topic: /c, state: AUTO}", "state", None),
        ("not {topic: /c, state: Auto}", "state", 'state of /b with "Auto", which it never was: it was "AUTO"'),
    ],
)
def test_a_text_is_looked_for_where_its_atom_asks_for_it(
    formula: str, held: str, said: str | None, tmp_path: Path
) -> None:
    spec = write_spec(tmp_path, SPEC.replace("FORMULA", formula).replace("HELD", held))
    lines = [
        {"topic": "/a", "time": 1, "data": "auto"},
        {"topic": "/b", "time": 2, "data": "AUTO"},
        {"topic": "/c", "time": 3, "x": 1},
    ]
    path = tmp_path / "log.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(spec, path)
    told = [text for text in found.summary["doubts"] if "which it never was" in text]
    assert len(told) == (said is not None)
    assert (said or "") in "".join(told)


@pytest.mark.parametrize(
    ("expression", "sent", "said"),
    [
        ("msg.mode == 'ARMED'", 2, 'compares msg.mode with "ARMED", and it was always a number'),
        ("msg.mode == 51", "51", "compares msg.mode with 51, and it was always a text"),
        ("msg.mode == 1", True, "compares msg.mode with 1, and it was always a boolean"),
        ("msg.mode in [1, 'ARMED']", 1, ""),
        ("msg.mode != 'NaN' && msg.mode == 3", "NaN", ""),
        ("msg.mode != 'NaN'", 7.5, ""),
        ("msg.mode == 'AUTO'", None, ""),
        ("msg.mode == 'AUTO'", "auto", 'compares msg.mode with "AUTO", which it never was: it was "auto"'),
        ("msg.mode != 'AUTO'", " Auto", 'compares msg.mode with "AUTO", which it never was: it was " Auto"'),
        ("'map' == msg.mode", "/map", 'compares msg.mode with "map", which it never was: it was "/map"'),
        ("msg.mode in ['AUTO', 'IDLE'] ? 1 : 2", "idle", 'compares msg.mode with "IDLE"'),
        ("msg.mode == 'AUTO' || msg.mode == 'auto'", "auto", ""),
        ("msg.mode.lower() == 'auto'", "AUTO", ""),
        ("msg.mode == 'AUTO'", "FAULT", ""),
    ],
)
def test_a_text_that_an_expression_spells_otherwise_is_said(
    expression: str, sent: object, said: str, tmp_path: Path
) -> None:
    signals = f"    signals:\n      on: |\n        {expression}\n"
    prop = "properties: [{id: p, formula: '{on: *} -> once {topic: /mode}'}]\n"
    spec = write_spec(tmp_path, f"id: a\nstreams:\n  - topic: /mode\n{signals}{prop}")
    path = tmp_path / "trace.jsonl"
    lines = [{"stream": "/mode", "stamp": n, "arrived": n, "data": {"mode": sent}} for n in (1, 2)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(spec, path)
    assert (found.exit, found.strict) == (0, 3 if said else 0)
    assert f"/mode: the signal on {said}" in found.said if said else not found.said


def test_a_text_that_a_derived_expression_spells_otherwise_is_said(tmp_path: Path) -> None:
    text = SPEC.replace("properties:", "derive: {on: \"state == 'Auto' || x > 3\"}\nproperties:").replace(
        "HELD", "state"
    )
    path = tmp_path / "log.jsonl"
    lines = [{"topic": "/b", "time": 2, "data": "AUTO"}, {"topic": "/c", "time": 3, "x": 1}]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(write_spec(tmp_path, text.replace("FORMULA", "not {on}")), path)
    assert 'on compares state with "Auto", which it never was: it was "AUTO"' in found.said
