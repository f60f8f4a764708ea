"""What the process that judges a recording tells of it where it does not come to its end."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from oracle_server.jobs import judging
from oracle_server.jobs.frames import Ended, Failed, Progress, Rows, Task
from oracle_server.jobs.judging import LARGEST, judge

SPEC = """
id: small
{ordering}
streams: [{{topic: /a, signals: {{v: msg.v}}}}]
properties: [{{id: a_is_small, formula: '{{topic: "/a"}} -> {{v < 10}}'}}]
"""
TWO = """
id: two
streams: [{topic: /a, signals: {v: msg.v}}, {topic: /b, type: std_msgs/msg/Float64, signals: {w: msg.data}}]
properties:
  - {id: a_is_small, formula: '{topic: "/a"} -> {v < 10}'}
  - {id: b_is_small, formula: '{topic: "/b"} -> {w < 10}'}
"""
AT = 10**18


def line(i: int, v: Any) -> str:
    at = AT + i * 10**6
    return json.dumps({"stream": "/a", "stamp": at, "arrived": at, "data": {"v": v}})


def frames(folder: Path, lines: list[str], ordering: str = "") -> list[Any]:
    path, told = folder / "log.jsonl", list[Any]()
    path.write_text("".join(f"{one}\n" for one in lines), encoding="utf-8")
    judge(Task(bytes(path), path.name, SPEC.format(ordering=ordering), [], 10**9), told.append)
    return told


@pytest.mark.parametrize("ordering", ["ordering: {by: arrival}", "ordering: {late: revise, horizon: 1s}"])
@pytest.mark.parametrize("count", [31, 64, 100])
def test_what_was_judged_before_a_bad_line_is_told_and_how_it_stands_then(
    count: int, ordering: str, tmp_path: Path
) -> None:
    told = frames(tmp_path, [*(line(i, 99 if i == count else 1) for i in range(1, count + 1)), "{garbage"], ordering)
    rows = [frame for frame in told if isinstance(frame, Rows)]
    steps = [step for frame in rows for step in frame.steps]
    assert [step.position for step in steps] == [*range(1, len(steps) + 1)]
    assert not any(isinstance(frame, Ended) for frame in told)
    failed = told[-1]
    assert isinstance(failed, Failed)
    assert "log.jsonl:" in failed.error
    assert failed.state is not None
    (prop,) = failed.state["properties"]
    kept = [step for step in steps if step.explanations]
    episodes = {each.episode.first: each.episode for frame in rows for each in frame.episodes}
    assert prop["violations"] == len(kept) == sum(episode.count for episode in episodes.values())
    assert not any(episode.open for episode in episodes.values())
    assert failed.state["counters"]["steps"] == len(steps)
    if "arrival" in ordering:
        assert (len(steps), prop["violations"], prop["outcome"]) == (count, 1, "currently_false")


@pytest.mark.parametrize("more", [[], ["{garbage"]])
def test_what_is_violated_to_the_end_is_an_episode_up_to_there(more: list[str], tmp_path: Path) -> None:
    """It was told as of the row at which it began: a robot that hung was wrong for no time."""
    told = frames(tmp_path, [*(line(i, 99 if i > 3 else 1) for i in range(1, 20)), *more], "ordering: {by: arrival}")
    episodes = [each.episode for frame in told if isinstance(frame, Rows) for each in frame.episodes]
    last = episodes[-1]
    assert (last.first, last.began, last.last, last.until) == (4, AT + 4 * 10**6, 19, AT + 19 * 10**6)
    assert not last.open


def test_no_episode_is_told_of_a_row_that_is_not(tmp_path: Path) -> None:
    """The row that is larger than the server takes violates: an episode of it would begin where there is nothing."""
    told = frames(tmp_path, [*(line(i, 1) for i in range(1, 20)), line(20, "x" * 2**21)], "ordering: {by: arrival}")
    rows = [frame for frame in told if isinstance(frame, Rows)]
    assert sum(len(frame.steps) for frame in rows) == 19
    assert [each for frame in rows for each in frame.episodes] == []
    assert isinstance(told[-1], Failed)
    assert "the server keeps 1048576 of one" in told[-1].error


def test_what_was_judged_is_told_where_a_stream_can_not_be_used(tmp_path: Path) -> None:
    path, told = tmp_path / "log.jsonl", list[Any]()
    lines = [line(i, 99 if i == 20 else 1) for i in range(1, 30)]
    lines += [line(i, 1).replace("/a", "/b").replace('"v"', '"x"') for i in range(30, 40)]
    path.write_text("".join(f"{one}\n" for one in lines), encoding="utf-8")
    judge(Task(bytes(path), path.name, TWO, [], 10**9), told.append)
    failed = told[-1]
    assert isinstance(failed, Failed)
    assert failed.state is not None
    told_of = {prop["id"]: prop["violations"] for prop in failed.state["properties"]}
    rows = [frame for frame in told if isinstance(frame, Rows)]
    episodes = {each.property: each.episode.count for frame in rows for each in frame.episodes}
    assert told_of == episodes == {"a_is_small": 1, "b_is_small": 1}
    assert failed.state["counters"]["steps"] == sum(len(frame.steps) for frame in rows) == 39


def test_of_a_bag_without_events_what_could_not_be_read_is_told(tmp_path: Path) -> None:
    """It was said to have none, and no more: they may all be in the part that is cut off."""
    path, told = tmp_path / "bag.mcap", list[Any]()
    path.write_bytes(b"\x89MCAP0\r\n\6" + (10**6).to_bytes(8, "little") + bytes(100))
    judge(Task(bytes(path), path.name, TWO, [], 10**9), told.append)
    none, further = told[-1].error.split("; bag.mcap: ")
    assert none == "bag.mcap: has no event at all; two observes /a, /b"
    assert further.startswith("ends early, in the record at byte 8 of ")


def test_what_can_not_be_told_costs_nothing_of_what_was_judged_before(tmp_path: Path) -> None:
    """A row that no frame can hold: those before it are told, and the state does not claim to be that of all rows."""
    path, rows = tmp_path / "log.jsonl", list[Any]()
    lines = [line(i, 99 if i == 20 else 1) for i in range(1, 40)]
    path.write_text("".join(f"{one}\n" for one in lines), encoding="utf-8")
    ended: list[Failed] = []

    def tell(frame: object) -> None:
        if isinstance(frame, Rows):
            if any(step.position == 30 for step in frame.steps):
                raise OverflowError
            rows.extend(frame.steps)
        elif isinstance(frame, Failed):
            ended.append(frame)

    judge(Task(bytes(path), path.name, SPEC.format(ordering=""), [], 10**9), tell)
    assert [step.position for step in rows] == [*range(1, 30)]
    assert any(step.explanations for step in rows)
    (failed,) = ended
    assert failed.state is None
    assert "beyond 64 bits" in failed.error


TEXTS = """
id: texts
streams: [{topic: /a, signals: {v: msg.v, name: msg.name}}]
properties: [{id: a_is_small, formula: '{topic: "/a"} -> {v < 10}'}]
"""


def long_line(i: int, size: int, **more: str) -> str:
    at = AT + i * 10**6
    return json.dumps({"stream": "/a", "stamp": at, "arrived": at, "data": {"v": 1, "name": "x" * size}, **more})


def told_of(folder: Path, lines: list[str]) -> list[Any]:
    path, told = folder / "log.jsonl", list[Any]()
    path.write_text("".join(f"{one}\n" for one in lines), encoding="utf-8")
    judge(Task(bytes(path), path.name, TEXTS, [], 10**9), told.append)
    return told


def test_long_texts_are_told_a_few_at_a_time(tmp_path: Path) -> None:
    """The server takes in at one go what is told at once: 64 rows of megabytes kept a robot waiting for seconds."""
    told = told_of(tmp_path, [long_line(i, 200_000) for i in range(40)])
    rows = [frame for frame in told if isinstance(frame, Rows)]
    assert sum(len(frame.steps) for frame in rows) == 40
    assert max(len(msgspec.msgpack.encode(frame)) for frame in rows) < 10**6
    assert isinstance(told[-1], Ended)


@pytest.mark.parametrize("where", ["signals", "source"])
def test_a_step_that_is_too_large_to_be_kept_ends_it_and_what_came_before_is_told(where: str, tmp_path: Path) -> None:
    vast = long_line(20, LARGEST) if where == "signals" else long_line(20, 1, source="x" * LARGEST)
    told = told_of(tmp_path, [*(long_line(i, 10) for i in range(20)), vast, long_line(21, 10)])
    assert [step.position for frame in told if isinstance(frame, Rows) for step in frame.steps] == [*range(1, 21)]
    failed = told[-1]
    assert isinstance(failed, Failed)
    assert failed.state is None
    assert failed.error.startswith("log.jsonl: an event of /a has 104")
    assert failed.error.endswith("or judge it by `oracle-server replay`")


@pytest.mark.parametrize(("monitors", "often"), [(1, True), (2_000, False)])
def test_a_large_state_is_told_more_seldom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, monitors: int, often: bool
) -> None:
    """The server reads it at one go, while robots' decisions wait: that of 2,000 monitors has 200 kB."""
    lines = [json.dumps(json.loads(line(n, 1)) | {"monitor": f"m{n % monitors}"}) for n in range(2_000)]
    passed = itertools.count()
    monkeypatch.setattr(judging, "time", SimpleNamespace(monotonic=lambda: next(passed) * 0.6))
    told = frames(tmp_path, lines)
    states = [frame for frame in told if isinstance(frame, Progress) and frame.state is not None]
    assert (len(states) > 1_500) == often
    assert states
    assert isinstance(told[-1], Ended)
