"""What a replay says of what one monitor holds, where another one's events are asked of beside it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.replay.judging import judge, write_spec

SPEC = """
id: two
ordering: {by: arrival}
streams:
  - {topic: /mode, signals: {mode: msg.mode}, hold: [mode]}
  - {topic: /cmd, signals: {speed: msg.v}}
  - {topic: /odom, signals: {x: msg.x}}
derive: {last_mode: {last: mode}, same: mode.upper()}
properties:
  - {id: p, formula: 'not ({topic: /cmd, speed > 1} and {MODE: AUTO})'}
"""


@pytest.mark.parametrize(
    ("signal", "monitors", "is_said"),
    [
        ("mode", "aaa", False),
        ("mode", "abb", True),
        ("mode", "aab", False),  # nothing is asked of /odom
        ("mode", "bab", True),
        ("last_mode", "abb", False),
        ("same", "abb", True),  # which is computed where the signal is, held or not
    ],
)
def test_what_is_held_for_another_monitor_is_said(tmp_path: Path, signal: str, monitors: str, *, is_said: bool) -> None:
    told = [("/mode", {"mode": "AUTO"}), ("/cmd", {"v": 1}), ("/odom", {"x": 1})]
    lines = [
        {"stream": name, "monitor": monitor, "stamp": n, "arrived": n, "data": data}
        for n, (monitor, (name, data)) in enumerate(zip(monitors, told, strict=True), 1)
    ]
    log = tmp_path / "trace.jsonl"
    log.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(write_spec(tmp_path, SPEC.replace("MODE", signal)), log)
    says = f"/mode: mode is held for {monitors[0]} alone, so that p did not see it at /cmd of {monitors[1]}"
    assert (says in found.said) is is_said
    assert (found.exit, found.strict) == (0, 3 if is_said else 0)
