"""Many small recordings, some of them broken, and specs for them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from oracle_server.replay.many.judging import Judge, Question, Task, Text, Unit
from oracle_server.replay.many.row import Row
from oracle_server.specfiles.load import load_spec

BASE = 1_732_147_200 * 10**9
MS = 10**6
SLOW = """
id: slow
ordering: {max_delay: 100ms}
streams:
  - {topic: /speed, signals: {speed: msg.data}}
properties:
  - {id: below_three, formula: '{speed < 3}'}
  - {id: slows, time: seconds, formula: 'forall[x]. {speed: *x, speed > 4} -> eventually[:20ms] {speed < 1}'}
"""
RISING = """
id: rising
ordering: {late: revise, max_delay: 10ms}
streams:
  - {topic: /speed, signals: {speed: msg.data}}
derive:
  before: {previous: speed}
properties:
  - {id: rises, formula: '{speed >= before} or not {before > -1}'}
"""
BROKEN = ("", "no recording\n", '{"stream": "/speed", "kind": "topic", "stamp": ')
"""What broken recordings hold."""


def write_specs(folder: Path) -> list[Path]:
    """Two specs."""
    paths = [folder / "slow.yaml", folder / "rising.yaml"]
    for path, text in zip(paths, (SLOW, RISING), strict=True):
        path.write_text(text)
    return paths


def write_recordings(folder: Path, count: int) -> list[Path]:
    """Recordings by name: each tenth one is broken, others violate, or have late events."""
    folder.mkdir()
    paths = [folder / f"r{i:03}.jsonl" for i in range(count)]
    for i, path in enumerate(paths):
        path.write_text(BROKEN[i // 10 % 3] if i % 10 == 7 else "".join(_lines(i)))
    return paths


def _lines(i: int) -> list[str]:
    stamps = [BASE + (i * 1000 + at * 10) * MS for at in range(20)]
    if i % 4 == 3:
        stamps[5], stamps[15] = stamps[15], stamps[5]
    return [
        json.dumps({
            "stream": "/speed", "kind": "topic", "stamp": stamp, "arrived": BASE + (i * 1000 + (at + 1) * 10) * MS,
            "data": {"data": (at * (i + 1)) % 10 / 2},
        }) + "\n"
        for at, stamp in enumerate(stamps)
    ]  # fmt: skip


def question(specs: Sequence[Path], **options: object) -> Question:
    """What is asked of each recording."""
    texts = []
    for path in specs:
        file = load_spec(path)
        names = tuple(prop.id for prop in file.spec.properties)
        texts.append(Text(str(path), file.text, f"digest of {path.name}", file.spec.id, names))
    return Question(tuple(texts), **options)  # type: ignore[arg-type]


def judged(asked: Question, recording: Path) -> list[Row]:
    """The rows of one recording, judged within this process."""
    task = Task(0, recording, tuple(range(len(asked.specs))))
    units = [said for said in Judge(asked).judge(task, lambda _part, _events: None) if isinstance(said, Unit)]
    return [row for unit in units for row in unit.rows]
