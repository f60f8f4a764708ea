"""A spec that revises is replayed with its revisions: what stands at the end counts, and what was revised is said."""

from __future__ import annotations

import csv
import json
from io import StringIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from oracle_server.replay import settling
from oracle_server.replay.command import run_replay
from tests.replay.judging import BASE, MS, Judgement, judge, write_spec

SPEC = """
id: near
ordering: {late: LATE, max_delay: 100ms}
streams:
  - {topic: /odom, latency: 0ms, signals: {v: msg.v}, hold: [v]}
  - {topic: /cmd, latency: 0ms, signals: {c: msg.c}}
properties:
  - {id: moves, formula: '{topic: "/cmd"} -> {v > 0}'}
  - {id: small, formula: 'not {c > 100}'}
"""
STEP = 100 * MS


def spec_of(folder: Path, late: str = "revise") -> Path:
    return write_spec(folder, SPEC.replace("LATE", late))


def lines_of(*late: tuple[int, int, int]) -> list[dict[str, Any]]:
    """A command every 100 ms for 3 s, after an odometry of 1; late ones with their value, stamp and arrival (ms)."""
    lines = [{"stream": "/odom", "stamp": BASE, "arrived": BASE, "data": {"v": 1}}]
    lines += [
        {"stream": "/cmd", "stamp": at, "arrived": at, "data": {"c": 1}}
        for at in range(BASE + STEP, BASE + 31 * STEP, STEP)
    ]
    for v, stamp, arrived in late:
        lines.append({"stream": "/odom", "stamp": BASE + stamp * MS, "arrived": BASE + arrived * MS, "data": {"v": v}})
    return sorted(lines, key=lambda line: line["arrived"])


def trace_of(folder: Path, *late: tuple[int, int, int]) -> Path:
    path = folder / "trace.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines_of(*late)))
    return path


STOPS, MOVES_ON = (0, 950, 960), (2, 1050, 1510)
"""The robot seems to stand still from 1.0 s on, until it is known at 1.51 s that it moved on at 1.05 s."""
FELL = (0, 1250, 1700)
"""At 1.7 s it is known that it stood still at 1.25 s."""


def judged(folder: Path, *late: tuple[int, int, int], kind: str = "revise") -> Judgement:
    return judge(spec_of(folder, kind), trace_of(folder, *late))


def outcomes(found: Judgement) -> dict[int, str | None]:
    """The outcomes of `moves` by stamp."""
    return {row["stamp"]: row["outcome"] for row in found.rows if row["property"] == "moves"}


def test_what_stands_is_what_the_events_in_order_say(tmp_path: Path) -> None:
    late = [STOPS, MOVES_ON, FELL, (3, 1850, 2300), (0, 1900, 2300), (4, 1960, 2400)]
    in_time = [(v, stamp, stamp) for v, stamp, _ in late]
    revised, wanted = judged(tmp_path, *late), judged(tmp_path, *in_time)
    assert outcomes(revised) == outcomes(wanted)
    for key in ("violations", "exit"):
        assert revised.summary[key] == wanted.summary[key]
    assert wanted.summary["revised"] == 0
    assert revised.summary["revised"] > 0


def test_a_violation_that_is_taken_back_is_none(tmp_path: Path) -> None:
    once, still = judged(tmp_path, STOPS, MOVES_ON), judged(tmp_path, STOPS, MOVES_ON, kind="judge")
    assert (once.summary["violations"], still.summary["violations"]) == (1, 1)
    late = judged(tmp_path, (0, 960, 960), (2, 970, 1510))
    assert (late.exit, late.strict, late.summary["violations"]) == (0, 0, 0)
    assert (late.summary["revised"], late.summary["retracted"], late.summary["appeared"]) == (5, 1, 0)
    assert "5 verdicts were revised, 1 violation retracted, because of events that came late" in late.said
    assert judged(tmp_path, (0, 960, 960), (2, 970, 1510), kind="judge").exit == 1


def test_a_violation_that_is_found_late_is_one(tmp_path: Path) -> None:
    found = judged(tmp_path, FELL)
    assert (found.exit, found.summary["violations"]) == (1, 1)
    assert (found.summary["retracted"], found.summary["appeared"]) == (0, 1)
    (row,) = [row for row in found.rows if row["violation"]]
    assert (row["stamp"], row["outcome"]) == (BASE + 13 * STEP, "currently_false")
    assert row["revised"] > row["n"]
    assert found.summary["properties"]["moves"]["first_violation_at"] == BASE + 13 * STEP


def test_events_that_were_put_in_their_place_are_no_doubt(tmp_path: Path) -> None:
    late = [(v, 300 + 100 * v, 620 + 100 * v) for v in range(1, 20)]
    found, doubted = judged(tmp_path, *late), judged(tmp_path, *late, kind="judge")
    assert (found.strict, doubted.strict) == (0, 3)
    (note,) = [note for note in found.summary["notes"] if note.startswith("/odom")]
    assert note.endswith("behind what was judged before; what was said without that was put right")


def test_beyond_the_horizon_they_are_late_as_ever(tmp_path: Path) -> None:
    found = judged(tmp_path, (0, 100, 2900))
    assert found.summary["revised"] == 0
    (note,) = [note for note in found.summary["notes"] if note.startswith("/odom")]
    assert note.endswith("behind what was judged before")


def test_the_views_tell_what_stands_what_was_said_and_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, trace = spec_of(tmp_path), trace_of(tmp_path, (0, 960, 960), (2, 970, 1510))
    told: dict[str, list[dict[str, Any]]] = {}
    for view in ("standing", "first", "all"):
        assert run_replay([spec], trace, None, "jsonl", view=view) == 0
        told[view] = [json.loads(line) for line in capsys.readouterr().out.splitlines()[:-1]]
    changed = [row["n"] for row in told["standing"] if "revised" in row]
    first = {row["n"]: row for row in told["first"]}
    assert [first[n]["outcome"] for n in changed] == ["currently_false"] * 5
    assert [row for row in told["all"] if row["kind"] != "revision"] == told["first"]
    revisions = [row for row in told["all"] if row["kind"] == "revision"]
    assert (revisions[0]["revises"]["from"], revisions[-1]["revises"]["to"]) == (changed[0], changed[-1])
    assert [row["retracted"] for row in revisions].count(True) == 1
    assert [row["n"] for row in told["standing"]] == [row["n"] for row in told["first"]]


def test_a_text_says_what_was_taken_back_where_all_is_wanted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec, trace = spec_of(tmp_path), trace_of(tmp_path, (0, 960, 960), (2, 970, 1510))
    run_replay([spec], trace, None, "text")
    assert "violation:" not in capsys.readouterr().out
    run_replay([spec], trace, None, "text", view="all")
    said = capsys.readouterr().out
    assert "violation: moves does not hold at step 12" in said
    assert (
        ": /odom (topic 18 of replay) came 540 ms late"
        in said.split("retracted: moves is not violated at verdict #23")[1]
    )


def test_junit_and_csv_tell_what_stands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, trace = spec_of(tmp_path), trace_of(tmp_path, FELL)
    assert run_replay([spec], trace, None, "junit", view="first") == 1
    suite = ElementTree.fromstring(capsys.readouterr().out)
    assert [case.get("name") for case in suite.iter("testcase") if case.find("failure") is not None] == ["moves"]
    assert next(suite.iter("failure")).text
    run_replay([spec], trace, None, "csv")
    rows = list(csv.DictReader(StringIO(capsys.readouterr().out)))
    assert {row["outcome"] for row in rows if row["revised"]} == {"currently_false"}
    run_replay([spec], trace, None, "csv", view="all")
    rows = list(csv.DictReader(StringIO(capsys.readouterr().out)))
    (first, *_) = [row for row in rows if row["kind"] == "revision"]
    assert first["because"].startswith("/odom (topic ")


def test_rows_are_let_go_of_once_nothing_can_change_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    late = [STOPS, MOVES_ON, FELL, (3, 1850, 2300)]
    at_the_end = judged(tmp_path, *late).rows
    monkeypatch.setattr(settling, "_EVERY", 0)
    assert judged(tmp_path, *late).rows == at_the_end


def test_by_arrival_nothing_is_revised(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, trace = spec_of(tmp_path), trace_of(tmp_path, (0, 960, 960), (2, 970, 1510))
    assert run_replay([spec], trace, "both", "jsonl") == 1
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])["summary"]
    assert "revised" not in summary
