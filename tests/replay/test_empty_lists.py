"""A list that an expression goes through, and that no message has any element of, is told: nothing was looked at."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.replay.judging import judge, write_spec

SPEC = """\
id: a
streams:
  - topic: /joint_states
    signals:
      fast: |
        EXPRESSION
      high: msg.velocity.exists(v, v > 9)
properties:
  - {id: p, formula: 'not {fast: true} and not {high: true}'}
"""
TOLD = "/joint_states: msg.velocity was empty in all 2 messages, and of its elements the signals fast and high ask"

ONE = "/joint_states: msg.velocity was empty in its one message, and of its elements the signal high asks"


@pytest.mark.parametrize(
    ("expression", "velocity", "told"),
    [
        ("msg.velocity.exists(v, v > 1)", [[], []], [TOLD]),
        ("!msg.velocity.all(v, v < 1)", [[], []], [TOLD]),
        ("7 in msg.velocity", [[], []], [TOLD]),
        ("msg.velocity.exists(v, v > 1)", [[], [0.5]], []),
        ("size(msg.velocity) > 7", [[]], [ONE]),
    ],
)  # fmt: skip
def test_a_list_that_was_always_empty_is_told(
    expression: str, velocity: list[list[float]], told: list[str], tmp_path: Path
) -> None:
    spec = write_spec(tmp_path, SPEC.replace("EXPRESSION", expression))
    path = tmp_path / "log.jsonl"
    lines = [{"topic": "/joint_states", "time": n, "velocity": each} for n, each in enumerate(velocity, 1)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(spec, path)
    assert [text for text in found.summary["notes"] if "was empty" in text] == told
    assert (found.exit, found.strict) == (0, 0), "a sound robot has no obstacles around it"
