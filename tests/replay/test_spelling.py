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
