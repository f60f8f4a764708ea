"""What is missing from an adapter's log is told by the numbers of its lines."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.replay.judging import Judgement, judge, write_spec

SPEC = """
id: numbered
streams: [{topic: /a, signals: {v: msg.v}}]
properties: [{id: low, formula: '{v < 5}'}]
"""
Numbered = tuple[str, int] | tuple[str, int, int]
"""A monitor, a number, and how many events the line tells as lost."""


def judged(folder: Path, lines: Iterable[Numbered], **first: int) -> Judgement:
    rows = []
    for at, (monitor, number, *lost) in enumerate(lines, start=1):
        row = {"stream": "/a", "monitor": monitor, "seq": number, "stamp": at, "arrived": at, "data": {"v": 1}}
        rows.append(row | ({"lost": lost[0]} if lost else {}) | (first if at == 1 else {}))
    path = folder / "log.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return judge(write_spec(folder, SPEC), path)


def test_missing_lines_are_told_and_are_no_strict_success(tmp_path: Path) -> None:
    found = judged(tmp_path, [("x", 1), ("y", 1), ("x", 2), ("y", 2), ("x", 5), ("x", 6), ("x", 8)])
    assert "log.jsonl:5: 2 events of 'x' missing before it, by the numbers of the lines (`seq`); 3 in all" in found.said
    assert "'y'" not in found.said
    assert (found.exit, found.strict) == (0, 3)


@pytest.mark.parametrize(
    "lines",
    [
        [("x", 7), ("x", 8), ("x", 9)],
        [("x", 1), ("x", 3), ("x", 2), ("x", 4)],
        [("x", 1), ("x", 1), ("x", 2)],
    ],
    ids=["begins later", "shuffled", "rows"],
)
def test_a_log_with_all_its_lines_is_a_success(lines: list[Numbered], tmp_path: Path) -> None:
    found = judged(tmp_path, lines)
    assert "seq" not in found.said
    assert (found.exit, found.strict) == (0, 0)


def test_what_a_line_tells_as_lost_is_not_told_twice(tmp_path: Path) -> None:
    found = judged(tmp_path, [("x", 1), ("x", 4, 2)])
    assert "seq" not in found.said
    assert "2 events lost while it was recorded" in found.said


def test_an_adapter_that_was_started_again_is_told(tmp_path: Path) -> None:
    found = judged(tmp_path, [("x", 1), ("x", 2), ("x", 1), ("x", 2), ("x", 1)])
    assert "log.jsonl:3: the numbers (`seq`) of 'x' begin anew (2 times in all)" in found.said
    assert (found.exit, found.strict) == (0, 0)


def test_a_sessions_trace_has_the_numbers_that_it_took(tmp_path: Path) -> None:
    found = judged(tmp_path, [("x", 1), ("x", 5), ("x", 2), ("x", 1)], begun=1)
    assert "seq" not in found.said
