"""Rates over more time than a recording lasts, which are never known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.replay.judging import judge, write_spec


@pytest.mark.parametrize(
    ("says", "said"),
    [
        ("pattern: '/mode at least 10 Hz over 60s'", "p: p.rate was never known: a rate is 60s after the "
         "begin, and the recording lasts 29 s"),
        ("formula: 'not {a_minute < 300}', time: seconds", "p: often was never known: a rate is 30s after the begin"),
        ("pattern: '/mode at least 10 Hz over 29s'", ""),
        ("pattern: '/mode at most 10 Hz over 60s'", ""),
    ],
)  # fmt: skip
def test_a_rate_over_more_than_the_recording_was_not_judged(says: str, said: str, tmp_path: Path) -> None:
    derive = "derive: {often: {rate: '{topic: /mode}', over: 30s}, a_minute: 60 * often}"
    text = f"id: a\nstreams: [{{topic: /mode}}]\n{derive}\nproperties: [{{id: p, {says}}}]\n"
    path = tmp_path / "trace.jsonl"
    lines = [{"stream": "/mode", "stamp": n, "arrived": n, "data": {}} for n in (100 * 10**9, 129 * 10**9)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(write_spec(tmp_path, text), path)
    assert (said in found.said, bool(found.said)) == (True, bool(said))
    assert (found.exit, found.strict) == ((0, 3) if said else (found.exit, found.exit))
