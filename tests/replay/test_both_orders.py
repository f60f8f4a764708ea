"""A recording is judged by both orders only where the spec may be."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.replay.command import run_replay
from oracle_server.replay.many.command import run_many


@pytest.mark.parametrize("many", [False, True])
def test_what_takes_denied_events_back_is_not_judged_by_both_orders(tmp_path: Path, many: bool) -> None:
    spec, trace = tmp_path / "g.yaml", tmp_path / "t.jsonl"
    spec.write_text(
        "id: g\nstreams:\n  - {topic: /a}\n  - {topic: /cmd, action: filter, on_deny: undo}\n"
        "properties:\n  - {id: slow, formula: 'historically not {v: 9}', guards: [/cmd]}\n"
    )
    trace.write_text('{"time": 1, "topic": "/cmd", "v": 1}\n')
    why = re.escape("g.yaml:4:44: `undo` needs one order: `by: both` judges an event by arrival before it is decided;")
    with pytest.raises(SpecError, match=why):
        run_many([trace], [spec], "both") if many else run_replay([spec], trace, "both", "jsonl")
    assert run_replay([spec], trace, "arrival", "jsonl") == 0
