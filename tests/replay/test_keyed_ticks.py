"""A session's own trace has ticks that are of one key of a derived signal: they are judged again as they were."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

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


def place(position: int, at: int) -> list[dict[str, Any]]:
    return [{"position": position, "order": "arrival", "judged": BASE + at * MS}]


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
