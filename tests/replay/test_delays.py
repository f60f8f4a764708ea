"""Streams whose events are late or skewed are said; where most of them are, that is no strict success."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.replay.judging import BASE, MS, Judgement, judge, write_spec

SPEC = """
id: fresh
ordering: {{{ordering}}}
streams:
  - {{topic: /scan, {scan}signals: {{}}}}
  - {{topic: /cmd, signals: {{v: msg.v}}}}
properties:
  - {{id: slow, formula: 'not {{v > 1}}'}}
"""


def judged(folder: Path, off: list[int], ordering: str = "max_delay: 100ms", scan: str = "") -> Judgement:
    """A scan every 100 ms whose stamps are off by so many ms, each before a command in time."""
    path = folder / "trace.jsonl"
    lines = []
    for n, by in enumerate(off):
        at = BASE + n * 100 * MS
        data: dict[str, Any] = {"ranges": [{}] * (50 if by else 1)}
        lines.append({"stream": "/scan", "stamp": at + by * MS, "arrived": at, "data": data})
        lines.append({"stream": "/cmd", "stamp": at + MS, "arrived": at + MS, "data": {"v": 0}})
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return judge(write_spec(folder, SPEC.format(ordering=ordering, scan=scan)), path)


@pytest.mark.parametrize("late", ["judge", "skip"])
def test_a_message_with_many_rows_is_late_once(tmp_path: Path, late: str) -> None:
    found = judged(tmp_path, [0] * 8 + [-600] + [0], f"max_delay: 100ms, late: {late}", "each: msg.ranges, ")
    said = "/scan: 1 of its 10 messages is late, up to 0.5 s behind what was judged before"
    assert said in found.summary["notes"]
    assert found.summary["late"] == 1
    skipped = "1 late event was skipped, and not judged"
    assert (skipped in found.summary["notes"]) is (late == "skip")


def test_a_stream_that_is_late_is_said(tmp_path: Path) -> None:
    found = judged(tmp_path, [-600] * 20)
    assert (found.exit, found.strict) == (0, 3)
    assert found.summary["notes"] == [
        "/scan: 18 of its 20 messages are late, up to 0.401 s behind what was judged before"
    ]


@pytest.mark.parametrize("arrived", [True, False])
def test_a_message_that_is_stamped_long_before_a_recording_begins_is_said(tmp_path: Path, *, arrived: bool) -> None:
    """It is not late, as nothing was judged before it: an hour passes behind it, in which nothing was recorded."""
    path = tmp_path / "trace.jsonl"
    stamps = [BASE - 3_600_000 * MS, *(BASE + n * 100 * MS for n in range(1, 20))]
    lines = [{"stream": "/scan", "stamp": stamp, "data": {}} for stamp in stamps]
    if arrived:
        lines = [{**line, "arrived": BASE + n * 100 * MS} for n, line in enumerate(lines)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    spec = write_spec(tmp_path, SPEC.format(ordering="", scan="") + "  - {id: often, pattern: /scan every 1s}\n")
    found = judge(spec, path)
    said = "3600.1 s before what was judged next, and arrived within 0.1 s of that: deadlines between these times ran"
    assert (said in found.said, found.summary["properties"]["often"]["violations"]) == (arrived, int(arrived))


@pytest.mark.parametrize(("source", "late"), [(True, 1), (False, 10)])
def test_publishers_are_waited_for_by_themselves_where_a_log_tells_them(
    tmp_path: Path, *, source: bool, late: int
) -> None:
    path, lines = tmp_path / "trace.jsonl", []
    for at in range(BASE, BASE + 1000 * MS, 100 * MS):
        for name, by in (("near", 0), ("far", -50)):
            more = {"source": name} if source else {}
            lines.append({"stream": "/scan", "stamp": at + by * MS, "arrived": at, "data": {}, **more})
            lines.append({"stream": "/cmd", "stamp": at, "arrived": at, "data": {"v": 0}})
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert judge(write_spec(tmp_path, SPEC.format(ordering="", scan="")), path).summary["late"] == late


def test_a_stream_that_is_skewed_is_said(tmp_path: Path) -> None:
    found = judged(tmp_path, [5000] * 20)
    assert (found.exit, found.strict) == (0, 3)
    assert found.summary["notes"] == [
        "/scan: its 20 messages are skewed, up to 5 s ahead of the arrival, and ordered by that"
    ]


def test_stamps_of_a_simulation_beside_times_of_the_recording_are_said_with_their_mend(tmp_path: Path) -> None:
    """A scan that is stamped by /clock, and a command without a stamp, which stands where it was recorded."""
    found = judged(tmp_path, [-BASE // MS + 5000] * 20)
    assert (found.exit, found.strict) == (0, 3)
    (note,) = found.summary["notes"]
    assert "late, up to 1.7" in note
    assert "`--by arrival` judges by the recording's alone" in note


@pytest.mark.parametrize("by", [-600, 5000])
@pytest.mark.parametrize("off", [4, 8])
def test_fewer_than_most_are_only_said(by: int, off: int, tmp_path: Path) -> None:
    found = judged(tmp_path, [0, 0, 0, 0] + [by] * off + [0] * 8)
    assert (found.exit, found.strict) == (0, 0)
    (note,) = found.summary["notes"]
    assert note.startswith(f"/scan: {off} of its {12 + off} messages are {'late' if by < 0 else 'skewed'}, up to ")


@pytest.mark.parametrize("by", [-3_600_000, 3_600_000])
def test_some_that_are_an_hour_from_their_place_are_a_doubt(by: int, tmp_path: Path) -> None:
    """As where a clock was set while it was recorded: most of the time it was right."""
    said = [judged(tmp_path, [0] * 20 + [by] * count).strict for count in (5, 6)]
    assert said == [0, 3]


def test_a_handful_is_no_matter_however_few_there_are(tmp_path: Path) -> None:
    found = judged(tmp_path, [5000] * 5)
    assert (found.exit, found.strict) == (0, 0)


RIGHT = {
    "in time": (0, "max_delay: 100ms", ""),
    "waited for": (-600, "max_delay: 1s", ""),
    "allowed": (5000, "max_skew: 10s, max_delay: 10s", ""),
    "late by arrival": (-600, "by: arrival", ""),
    "skewed by arrival": (5000, "by: arrival", ""),
    "late and not ordered": (-600, "max_delay: 100ms", "ordered: false, "),
    "skewed and not ordered": (5000, "max_delay: 100ms", "ordered: false, "),
}


@pytest.mark.parametrize("case", RIGHT)
def test_a_stream_in_its_place_is_no_matter(case: str, tmp_path: Path) -> None:
    by, ordering, scan = RIGHT[case]
    found = judged(tmp_path, [by] * 20, ordering, scan)
    assert (found.exit, found.strict, found.said) == (0, 0, "")


def test_by_both_orders_an_event_counts_once(tmp_path: Path) -> None:
    found = judged(tmp_path, [5000] * 20, "by: both")
    assert "/scan: its 20 messages are skewed" in found.said


ANSWERED = """
id: answered
ordering: {max_delay: 200ms}
streams: [{topic: /goal}, {topic: /status}]
properties: [{id: goals, pattern: '/goal causes /status within 500ms'}]
"""
BEHIND = {
    "a simulation": (BASE - 5000 * MS, "; where the stamps are in a simulation's time, and those of the rec"),
    "a slow link": (600 * MS, "/status: its 10 messages are older than a deadline that was judged before: up to 0.6 s"),
    "as fast as it must be": (200 * MS, ""),
}


@pytest.mark.parametrize("case", BEHIND)
def test_messages_that_came_after_a_deadline_that_they_were_in_time_for_are_said(case: str, tmp_path: Path) -> None:
    """Each goal is answered after 400 ms, and all come so much behind their stamps."""
    behind, said = BEHIND[case]
    path = tmp_path / "trace.jsonl"
    lines = [
        {"stream": stream, "stamp": at - behind, "arrived": at, "data": {}}
        for n in range(10)
        for stream, at in (("/goal", BASE + n * 1000 * MS), ("/status", BASE + (n * 1000 + 400) * MS))
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(write_spec(tmp_path, ANSWERED), path)
    assert (found.exit, found.summary["violations"]) == ((1, 10) if said else (0, 0))
    assert said in found.said
    assert len(found.summary["notes"]) == bool(said)


@pytest.mark.parametrize(("epoch", "said"), [("unix", True), ("boot", False)])
@pytest.mark.parametrize("beside", [True, False])
def test_stamps_since_the_robots_start_are_said_with_their_mend(
    epoch: str, tmp_path: Path, *, beside: bool, said: bool
) -> None:
    """Late beside a stream that has the time of day, and overtaken by a deadline where there is no other stream."""
    path = tmp_path / "trace.jsonl"
    lines = [
        {"stream": "/status", "arrived": BASE + n * 1000 * MS, "data": {"timestamp": 60_000_000 + n * 1_000_000}}
        for n in range(10)
    ]
    lines += [{"stream": "/cmd", "arrived": BASE + (n * 1000 + 500) * MS, "data": {}} for n in range(10 * beside)]
    lines.sort(key=lambda line: str(line["arrived"]))
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    spec = (
        f"id: px4\nstreams:\n  - {{topic: /status, stamp: {{field: timestamp, unit: us, epoch: {epoch}}}}}\n"
        "  - {topic: /cmd}\nproperties: [{id: p, pattern: '/status every 2s'}]\n"
    )
    mend = "; where `timestamp` counts since the robot's start, as PX4's do, its `stamp` takes `epoch: boot`"
    assert (mend in judge(write_spec(tmp_path, spec), path).said) is said
