"""A recording of a filtered robot: what nodes asked for is judged, and what passed is told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.spec import SECOND
from oracle_server.replay.bags.passing import Filter
from tests.replay.judging import BASE, MS, exit_of, judge, write_numbers, write_spec

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
    assert exit_of(spec(tmp_path), bag, strict=True) == 3


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


def lines(folder: Path, *events: tuple[str, int, float], form: str = "jsonl") -> Path:
    """A log with messages of these names, times in ms and speeds."""
    path = folder / f"log.{form}"
    found = []
    for name, at, speed in sorted(events, key=lambda event: event[1]):
        if form == "jsonl":
            found.append({"stream": name, "arrived": BASE + at * MS, "data": {"data": speed}})
        else:
            found.append({"topic": name.strip("/"), "time": (BASE + at * MS) / 1e9, "data": speed, "verdict": "true"})
    path.write_text("".join(json.dumps(line) + "\n" for line in found))
    return path


def of(name: str, events: list[tuple[int, float]]) -> list[tuple[str, int, float]]:
    return [(name, at, speed) for at, speed in events]


@pytest.mark.parametrize("form", ["jsonl", "txt"])
@pytest.mark.parametrize("intercept", ["publisher", "subscriber"])
def test_a_log_of_both_sides_is_read_as_a_bag_of_both(intercept: str, form: str, tmp_path: Path) -> None:
    asked, passed = ("/cmd_vel_mon", "/cmd_vel") if intercept == "publisher" else ("/cmd_vel", "/cmd_vel_mon")
    on_deny = "undo" if intercept == "publisher" else "keep"
    log = lines(tmp_path, *of(asked, ASKED), *of(passed, PASSED), form=form)
    found = judge(spec(tmp_path, intercept, on_deny), log)
    assert (found.summary["events"], found.summary["ignored"]) == (len(ASKED), 0)
    assert {row["stream"] for row in found.rows} == {"/cmd_vel"}
    assert [row["passed"] for row in found.rows] == [True, False, True, False, True]
    denied = [False, True, False, True, False] if on_deny == "undo" else [False, True, True, True, True]
    assert [row["decision"] == "deny" for row in found.rows] == denied
    assert found.exit == 1


def test_a_log_of_attempts_alone_is_judged(tmp_path: Path) -> None:
    found = judge(spec(tmp_path), lines(tmp_path, *of("/cmd_vel_mon", ASKED)))
    assert (found.summary["events"], found.exit) == (len(ASKED), 1)
    assert {row["passed"] for row in found.rows} == {None}
    found = judge(spec(tmp_path), lines(tmp_path, *of("/cmd_vel", ASKED)))
    assert (found.summary["events"], found.exit, found.said) == (len(ASKED), 1, "")


def test_a_log_of_what_passed_alone_is_no_strict_success(tmp_path: Path) -> None:
    found = judge(spec(tmp_path, "subscriber", "keep"), lines(tmp_path, *of("/cmd_vel_mon", PASSED)))
    assert (found.summary["events"], found.exit, found.strict) == (len(PASSED), 0, 3)
    assert "/cmd_vel: what passed was judged; the recording has no /cmd_vel, so denied attempts are not" in found.said


def test_what_passed_beside_the_filter_is_said_of_a_log(tmp_path: Path) -> None:
    past = [*PASSED, (60, 9.0)]
    asked = [ASKED[0], ASKED[2], ASKED[4]]
    found = judge(spec(tmp_path), lines(tmp_path, *of("/cmd_vel_mon", asked), *of("/cmd_vel", past)))
    assert (found.exit, found.strict) == (0, 3)
    assert "/cmd_vel: 1 message passed that nobody asked for, and was not judged" in found.said


def test_a_spec_that_observes_the_other_name_keeps_both(tmp_path: Path) -> None:
    text = SPEC.format(intercept="publisher", on_deny="keep").replace(
        "properties:", "  - {topic: /cmd_vel_mon, type: std_msgs/msg/Float64, signals: {wish: msg.data}}\nproperties:"
    )
    log = lines(tmp_path, *of("/cmd_vel_mon", ASKED), *of("/cmd_vel", PASSED))
    found = judge(write_spec(tmp_path, text), log)
    assert found.summary["streams"]["/cmd_vel_mon"]["events"] == len(ASKED)
    assert found.summary["streams"]["/cmd_vel"]["events"] == len(PASSED)


SERVICE = """
id: led
ordering: {by: arrival}
streams:
  - service: /set
    type: std_srvs/srv/SetBool
    action: filter
    denied_response: {success: false}
    request: {signals: {on: msg.data}}
    response: {signals: {success: msg.success}}
properties:
  - {id: off, formula: '{service: /set, kind: request} -> {on: false}', guards: [/set]}
  - {id: done, formula: '{service: /set, kind: response} -> {success: true}'}
"""


@pytest.mark.parametrize("numbered", [True, False])
def test_requests_to_a_proxy_are_attempts(numbered: bool, tmp_path: Path) -> None:
    def half(name: str, kind: str, at: int, call: int, data: dict[str, Any]) -> dict[str, Any]:
        line = {"stream": name, "kind": kind, "arrived": BASE + at * MS, "data": data}
        return {**line, "call": call} if numbered else line

    calls = [
        half("/set_mon", "request", 0, 1, {"data": False}),
        half("/set", "request", 1, 7, {"data": False}),
        half("/set", "response", 2, 7, {"success": True, "message": ""}),
        half("/set_mon", "response", 3, 1, {"success": True, "message": ""}),
        half("/set_mon", "request", 10, 2, {"data": True}),
        half("/set_mon", "response", 11, 2, {"success": False, "message": "denied"}),
    ]
    path = tmp_path / "log.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in calls))
    found = judge(write_spec(tmp_path, SERVICE), path)
    seen = {(row["kind"], row["seq"]): (row["decision"], row["passed"]) for row in found.rows}
    assert list(seen.values()) == [("allow", True), (None, None), ("deny", False)]
    assert {row["stream"] for row in found.rows} == {"/set"}
    assert {name: state["violations"] for name, state in found.summary["properties"].items()} == {"off": 1, "done": 0}
