"""A recording that pauses far longer than ever else is said to: deadlines run out in it, and nobody waited so long."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from tests.replay.judging import BASE, MS, judge, write_numbers, write_spec

SPEC = """
id: numbers
streams: [{topic: /a, signals: {v: msg.data}}]
properties: [{id: low, formula: '{v: *} -> {v < 5}'}]
"""
HOUR = 3_600_000
SAID = (
    "nothing arrived for 3600 s, from 00:00:01.500Z to 01:00:01.500Z, and never else for more than 0.01 s: a clock "
    "was set, the recorder was paused, or messages are missing; deadlines between these times ran out"
)


def times(behind: int = 151) -> list[int]:
    """In ms, a clock that leaps by an hour after 151 of some messages."""
    return [i * 10 for i in range(151)] + [HOUR + i * 10 for i in range(150, 150 + behind)]


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_clock_that_leaps_within_a_bag_is_said(storage: StoragePlugin, tmp_path: Path) -> None:
    found = judge(
        write_spec(tmp_path, SPEC), write_numbers(tmp_path / "bag", {"/a": [(at, 1.0) for at in times()]}, storage)
    )
    assert (found.exit, found.strict, found.said) == (0, 3, SAID)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_topic_that_pauses_while_others_go_on_is_none(storage: StoragePlugin, tmp_path: Path) -> None:
    topics = {"/a": [(at, 1.0) for at in times()], "/other": [(HOUR // 2, 1.0)]}
    found = judge(write_spec(tmp_path, SPEC), write_numbers(tmp_path / "bag", topics, storage))
    assert (found.strict, found.said) == (0, "")


def test_a_few_messages_behind_a_pause_tell_nothing_of_it(tmp_path: Path) -> None:
    bag = write_numbers(tmp_path / "bag", {"/a": [(at, 1.0) for at in times(99)]}, StoragePlugin.MCAP)
    assert judge(write_spec(tmp_path, SPEC), bag).said == ""


def test_of_a_log_it_is_no_doubt(tmp_path: Path) -> None:
    """It has what was observed alone, and the robot may have stood."""
    path = tmp_path / "log.jsonl"
    lines = ({"stream": "/a", "kind": "topic", "arrived": BASE + at * MS, "data": {"data": 1}} for at in times())
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(write_spec(tmp_path, SPEC), path)
    assert (found.strict, found.said) == (0, SAID)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize(("at", "when"), [(0, "00:00:00.000Z"), (-BASE // MS, "0.000 s")])
def test_a_bag_in_which_no_time_passes_is_said(at: int, when: str, storage: StoragePlugin, tmp_path: Path) -> None:
    """As of a recorder that never heard the clock of a simulation: whatever is to hold within 1 s does."""
    spec = write_spec(tmp_path, SPEC.replace("formula", "time: seconds, formula"))
    bag = write_numbers(tmp_path / "bag", {"/a": [(at, 1.0)] * 20}, storage)
    found = judge(spec, bag)
    said = f"all its 20 messages arrived at the same time, {when}: none passes in it, and what is asked of it was not"
    assert (found.exit, found.strict, found.said) == (0, 3, f"{said} judged (low)")


@pytest.mark.parametrize(("step", "strict"), [(0, 3), (1, 0)])
def test_time_passes_in_a_log_by_its_stamps(step: int, strict: int, tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    lines = [{"stream": "/a", "kind": "topic", "stamp": BASE - n * step, "arrived": BASE} for n in range(20, 0, -1)]
    path.write_text("".join(json.dumps({**line, "data": {"data": 1}}) + "\n" for line in lines))
    assert judge(write_spec(tmp_path, SPEC.replace("formula", "time: seconds, formula")), path).strict == strict


@pytest.mark.parametrize(("last", "said"), [(0, True), (BASE // MS, False)])
def test_a_topic_without_any_time_beside_others_that_have_some_is_said(last: int, said: bool, tmp_path: Path) -> None:
    """What was recorded at 0 stands at the beginning: of whatever was said within 1 s nothing is there."""
    zeros = [(at - BASE // MS, 1.0) for at in [0] * 19 + [last]]
    topics = {"/a": zeros, "/b": [(at, 1.0) for at in range(5)]}
    found = judge(write_spec(tmp_path, SPEC), write_numbers(tmp_path / "bag", topics, StoragePlugin.MCAP))
    what = "/a: its 20 messages have the time of recording 0, which is none, and stand at the beginning"
    assert (found.strict, found.said) == ((3, what) if said else (0, ""))
