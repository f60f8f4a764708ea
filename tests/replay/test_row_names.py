"""A name that an expression looks for among the rows of messages, and that none has, is told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.replay.judging import judge, write_spec

SPEC = """\
id: a
streams:
  - topic: /diagnostics
    signals:
      s: |
        EXPRESSION
  - {topic: /rows, each: msg.rows, signals: {lidar: "ROW"}}
properties:
  - {id: p, formula: 'not {s: true}'}
  - {id: q, formula: 'not {lidar: true}'}
"""
STATUS: list[dict[str, Any]] = [
    {"h": {"name": "lidar_front"}, "name": "lidar_front", "id": 3, "level": 0},
    {"h": {"name": "camera"}, "name": "camera", "id": 4, "level": 0},
]
HAD = 'which it never was: it was "lidar_front" and "camera"'


def doubts(
    folder: Path, expression: str, row: str = "item.name == 'camera' && item.level > 0", **other: Any
) -> list[str]:
    spec = write_spec(folder, SPEC.replace("EXPRESSION", expression).replace("ROW", row))
    lines = [
        {"topic": "/diagnostics", "status": STATUS, "names": ["lidar_front", "camera"], "q": [0.5, 1], **other},
        {"topic": "/diagnostics", "status": STATUS, "names": ["lidar_front", "camera"], "q": [0.25, 2], **other},
        {"topic": "/rows", "rows": STATUS},
    ]
    path = folder / "log.jsonl"
    path.write_text("".join(json.dumps({"time": n, **line}) + "\n" for n, line in enumerate(lines, 1)))
    found = judge(spec, path)
    assert found.strict == (3 if found.summary["doubts"] else 0)
    told: list[str] = found.summary["doubts"]
    return told


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("msg.status.exists(x, x.name == 'lidar' && x.level > 0)", f'compares name of msg.status with "lidar", {HAD}'),
        ("!msg.status.all(x, x.h.name != 'lidar' || x.level == 0)", f'h.name of msg.status with "lidar", {HAD}'),
        ("size(msg.status.filter(x, 'lidar' == x.name)) > 0", f'compares name of msg.status with "lidar", {HAD}'),
        (
            "msg.status.exists(x, x.name == 'lidar' && x.level > 0) || msg.q.exists(x, x > 9)",
            f'compares name of msg.status with "lidar", {HAD}',
        ),
        ("msg.names.exists(n, n == 'lidar')", f'compares the elements of msg.names with "lidar", {HAD}'),
        ("'lidar' in msg.names", f'compares the elements of msg.names with "lidar", {HAD}'),
        ("msg.status.exists(x, x.id == 5 && x.level > 0)", "id of msg.status with 5, which it never was: it was 3"),
        ("msg.status.exists(x, x.name in ['lidar', 'radar'] && x.level > 0)", 'with "radar"'),
        ("msg.status.exists(x, x.name in ['lidar', 'camera'] && x.level > 0)", ""),
        ("msg.status.exists(x, x.name == 'camera' && x.level > 0)", ""),
        ("'camera' in msg.names && size(msg.names) > 5", ""),
        ("msg.status.exists(x, x.level == 2)", ""),
        ("msg.q.exists(x, x == 7)", ""),
        ("msg.status.exists(x, x.name == '' && x.id == 3.5)", ""),
    ],
)  # fmt: skip
def test_a_name_that_no_row_has_is_told(expression: str, said: str, tmp_path: Path) -> None:
    told = doubts(tmp_path, expression)
    assert bool(told) == (said != "")
    assert said in "".join(told)


def test_so_is_one_that_is_compared_with_a_row_of_a_stream_with_each(tmp_path: Path) -> None:
    (told,) = doubts(tmp_path, "false", "item.name == 'lidar' && item.level > 0")
    assert told == f'/rows: the signal lidar compares name of msg.rows with "lidar", {HAD}'


def test_what_a_list_has_of_itself_twice_is_no_name(tmp_path: Path) -> None:
    twice = [{"name": "warning", "level": 1}, {"name": "warning", "level": 2}]
    assert doubts(tmp_path, "msg.status.exists(x, x.name == 'error')", status=twice) == []


@pytest.mark.parametrize(("name", "said"), [("estop", False), ("low_batery", True)])
def test_names_that_come_and_go_are_told_where_another_is_spelt_like_one(name: str, said: bool, tmp_path: Path) -> None:
    spec = write_spec(tmp_path, SPEC.replace("EXPRESSION", f"'{name}' in msg.active").replace("ROW", "false"))
    active: tuple[list[str], ...] = ["low_battery", "no_map"], ["low_battery"], []
    lines: list[dict[str, Any]] = [{"topic": "/rows", "time": 9, "rows": STATUS}]
    lines += [{"topic": "/diagnostics", "time": n, "active": each} for n, each in enumerate(active, 10)]
    path = tmp_path / "log.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert any("which it never was" in text for text in judge(spec, path).summary["doubts"]) == said


NUMBERED = """\
id: a
streams:
  - {topic: /motors, each: msg.motors, signals: {id: item.id, hot: item.t > 80}}
properties:
  - {id: cool, formula: 'not {id: ASKED, hot}'}
"""


@pytest.mark.parametrize(
    ("asked", "second", "said"),
    [
        (3, (1, 2), "cool compares id of /motors with 3, which it never was: it was 1 and 2"),
        (2, (1, 2), ""),
        (3, (1, 4), ""),  # they come and go, as what a camera sees
        (3, (1, 1), ""),
    ],
)
def test_a_number_of_no_row_is_told_where_each_message_has_the_same(
    asked: int, second: tuple[int, int], said: str, tmp_path: Path
) -> None:
    lines = [{"topic": "/motors", "motors": [{"id": i, "t": 20} for i in ids]} for ids in ((1, 2), second)]
    path = tmp_path / "log.jsonl"
    path.write_text("".join(json.dumps({"time": n, **line}) + "\n" for n, line in enumerate(lines, 1)))
    found = judge(write_spec(tmp_path, NUMBERED.replace("ASKED", str(asked))), path)
    assert found.summary["doubts"] == [said] * bool(said)
