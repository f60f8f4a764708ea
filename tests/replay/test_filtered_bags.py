"""A bag of a filtered robot: what nodes asked for is judged, and what passed is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.spec import SECOND
from oracle_server.replay.passing import Filter
from tests.replay.judging import exit_of, judge, write_numbers, write_spec

BOTH = (StoragePlugin.MCAP, StoragePlugin.SQLITE3)
SPEC = """
id: base
streams:
  - topic: /cmd_vel
    type: std_msgs/msg/Float64
    action: filter
    intercept: {intercept}
    on_deny: {on_deny}
    signals: {{speed: msg.data}}
properties:
  - {{id: slow, formula: 'historically {{speed <= 1}}', guards: [/cmd_vel]}}
"""
ASKED = [(0, 0.5), (10, 3.0), (20, 0.5), (30, 3.0), (40, 0.75)]
PASSED = [(2, 0.5), (22, 0.5), (42, 0.75)]


def spec(folder: Path, intercept: str = "publisher", on_deny: str = "undo") -> Path:
    return write_spec(folder, SPEC.format(intercept=intercept, on_deny=on_deny))


@pytest.mark.parametrize("storage", BOTH)
@pytest.mark.parametrize("intercept", ["publisher", "subscriber"])
def test_attempts_are_judged_and_what_passed_is_read(intercept: str, storage: StoragePlugin, tmp_path: Path) -> None:
    names = ("/cmd_vel_mon", "/cmd_vel") if intercept == "publisher" else ("/cmd_vel", "/cmd_vel_mon")
    bag = write_numbers(tmp_path / "bag", dict(zip(names, (ASKED, PASSED), strict=True)), storage)
    on_deny = "undo" if intercept == "publisher" else "keep"
    found = judge(spec(tmp_path, intercept, on_deny), bag)
    assert found.summary["events"] == len(ASKED)
    assert found.summary["ignored"] == 0
    assert {row["stream"] for row in found.rows} == {"/cmd_vel"}
    assert [row["passed"] for row in found.rows] == [True, False, True, False, True]
    denied = [False, True, False, True, False] if on_deny == "undo" else [False, True, True, True, True]
    assert [row["decision"] == "deny" for row in found.rows] == denied
    assert found.exit == 1
    assert found.summary["violations"] == (2 if on_deny == "undo" else 1)


def test_where_only_what_passed_is_there_that_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_numbers(tmp_path / "bag", {"/cmd_vel": PASSED}, StoragePlugin.MCAP)
    assert exit_of(spec(tmp_path), bag) == 0
    said = "/cmd_vel: what passed was judged; the recording has no /cmd_vel_mon, so denied attempts are not in it"
    assert said in capsys.readouterr().out


def test_what_passed_beside_the_filter_is_said(tmp_path: Path) -> None:
    past = [*PASSED, (60, 9.0), (61, 9.0)]
    bag = write_numbers(
        tmp_path / "bag", {"/cmd_vel_mon": ASKED[:1] + ASKED[2:3] + ASKED[4:], "/cmd_vel": past}, BOTH[0]
    )
    found = judge(spec(tmp_path), bag)
    assert "/cmd_vel: 2 messages passed that nobody asked for, and were not judged" in found.said
    assert (found.exit, found.strict) == (0, 3)


def test_attempts_alone_are_judged_and_what_passed_is_not_known(tmp_path: Path) -> None:
    found = judge(spec(tmp_path), write_numbers(tmp_path / "bag", {"/cmd_vel_mon": ASKED}, StoragePlugin.MCAP))
    assert found.summary["events"] == len(ASKED)
    assert {row["passed"] for row in found.rows} == {None}


def test_a_topic_that_is_only_logged_is_itself(tmp_path: Path) -> None:
    text = SPEC.format(intercept="publisher", on_deny="keep").replace("action: filter", "action: log")
    text = text.replace("guards: [/cmd_vel]", "description: none").replace("    intercept: publisher\n", "")
    path = write_spec(tmp_path, text.replace("    on_deny: keep\n", ""))
    bag = write_numbers(tmp_path / "bag", {"/cmd_vel_mon": ASKED, "/cmd_vel": PASSED}, StoragePlugin.MCAP)
    found = judge(path, bag)
    assert (found.summary["events"], found.summary["ignored"]) == (len(PASSED), len(ASKED))


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans()), max_size=30))
def test_each_attempt_passes_at_most_once_and_equal_ones_are_told_apart(attempts: list[tuple[int, bool]]) -> None:
    """Where a decision is there before the next attempt, it is known exactly which attempts passed."""
    link = Filter(SECOND)
    for number, (content, passed) in enumerate(attempts):
        link.asked(number * 100 * SECOND, bytes([content]))
        if passed:
            link.gave(number * 100 * SECOND + 1, bytes([content]))
    link.settle()
    assert [link.take() for _ in attempts] == [passed for _, passed in attempts]
    assert link.others == 0


def test_what_is_recorded_a_little_early_is_still_that_of_its_attempt() -> None:
    link = Filter(SECOND)
    for at in (1_000_000, 50_000_000):
        link.asked(at, b"a")
    link.gave(999_000, b"a")
    link.settle()
    taken: list[Any] = [link.take(), link.take()]
    assert (taken, link.others) == ([True, False], 0)
