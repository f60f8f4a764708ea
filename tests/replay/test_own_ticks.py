"""Ticks of a session's own trace are judged again as they were: those of one key, and those before all events."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.errors import TraceError
from oracle_server.replay.command import run_replay
from tests.replay.judging import judge, write_spec

MS = 10**6
BASE = 1_732_147_200_000 * MS
SPEC = """
id: sums
ordering: {by: arrival}
streams:
  - {topic: /x, signals: {name: msg.name, val: msg.val}}
derive:
  sum: {sum: val, over: 1s, by: name}
properties:
  - {id: little, formula: 'not {sum > 20}', time: seconds}
"""
SENT = [(0, {"name": "a", "val": 5}), (300, {"name": ["no"], "val": 3}), (800, {"name": "a", "val": 30}),
        (1600, {"name": "b", "val": 1})]  # fmt: skip


def place(position: int, at: int, order: str = "arrival") -> list[dict[str, Any]]:
    return [{"position": position, "order": order, "judged": BASE + at * MS}]


def test_they_are_what_they_were(tmp_path: Path) -> None:
    """From 1.3 s on no sum fails any more, and that of `a` is violated."""
    plain, own = [], []
    for n, (at, data) in enumerate(SENT, 1):
        line = {"stream": "/x", "monitor": "m", "seq": n, "stamp": BASE + at * MS, "arrived": BASE + at * MS}
        plain.append(line | {"data": data})
        failed = [name for name, value in data.items() if isinstance(value, list)]
        signals = {name: value for name, value in data.items() if name not in failed}
        own.append(line | {"signals": signals, "failed": failed, "places": place(n + (n > 3), at)})
    tick = {"stream": "", "kind": "tick", "monitor": "", "seq": 1, "stamp": BASE + 1300 * MS}
    tick |= {"arrived": BASE + 1300 * MS, "signals": {"name": "a"}, "failed": [], "places": place(4, 1300)}
    own.insert(3, tick)
    own[0]["begun"] = BASE
    found = []
    for name, lines in (("plain", plain), ("own", own)):
        path = tmp_path / f"{name}.jsonl"
        path.write_text("".join(json.dumps(line) + "\n" for line in lines))
        rows = judge(write_spec(tmp_path, SPEC), path).rows
        found.append([(row["n"], row["kind"], row["outcome"], row["violation"]) for row in rows])
    assert found[0] == found[1]
    assert (4, "tick", "currently_false", True) in found[1]


def test_what_comes_before_the_first_event_tells_of_one_order_alone(tmp_path: Path) -> None:
    """Nothing is heard for 0.3 s, which is missed by arrival, and then by publication."""
    spec = SPEC.split("derive:", maxsplit=1)[0].replace("arrival", "both")
    spec += "properties:\n  - {id: lives, formula: 'once[:300ms] {topic: /x}', time: seconds}\n"
    at = {"stamp": BASE + 300 * MS, "arrived": BASE + 300 * MS}
    tick = {"stream": "", "kind": "tick", "monitor": "", "seq": 1, "signals": {}, "failed": []} | at
    event = {"stream": "/x", "monitor": "m", "seq": 1, "signals": {"val": 1}, "failed": []}
    event |= {"stamp": BASE + 600 * MS, "arrived": BASE + 600 * MS}
    lines = [
        tick | {"begun": BASE, "places": place(1, 300)},
        tick | {"places": place(2, 330, "publication")},
        event | {"places": [*place(3, 600), *place(4, 630, "publication")]},
    ]
    path = tmp_path / "own.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    rows = judge(write_spec(tmp_path, spec), path).rows
    assert [(row["n"], row["order"], row["kind"], row["outcome"]) for row in rows] == [
        (1, "arrival", "tick", "currently_false"),
        (2, "publication", "tick", "currently_false"),
        (3, "arrival", "topic", "currently_true"),
        (4, "publication", "topic", "currently_true"),
    ]


def test_a_line_that_the_session_did_not_judge_is_refused(tmp_path: Path) -> None:
    """As where another log was appended: it would count as an event, and never be judged."""
    at = {"stamp": BASE, "arrived": BASE}
    own = {"stream": "/x", "monitor": "m", "seq": 1, "signals": {"val": 1}, "places": place(1, 0), "begun": BASE} | at
    other = {"stream": "/x", "data": {"name": "a", "val": 30}} | at
    path = tmp_path / "own.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in (own, other)))
    with pytest.raises(TraceError, match=r"own\.jsonl:2: does not tell where the session judged it"):
        judge(write_spec(tmp_path, SPEC), path)
    assert run_replay([write_spec(tmp_path, SPEC)], path, "arrival", "text") == 1
