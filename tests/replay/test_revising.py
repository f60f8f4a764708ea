"""What `replay` says of verdicts that a late event puts right, in every format."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from oracle_server.replay.command import run_replay

SPEC = """
id: causes
ordering: {late: revise, max_delay: 100ms, horizon: 5s}
streams:
  - {topic: /a, signals: {v: msg.v}}
  - {topic: /b, signals: {v: msg.v}}
properties:
  - {id: b_after_a, formula: 'forall[i]. {topic: "/b", v: *i} -> once {topic: "/a", v: *i}'}
"""
MS = 10**6
BEGIN = 1_732_147_200 * 10**9


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "causes.yaml"
    path.write_text(SPEC)
    return path


def trace(folder: Path, *events: tuple[str, int, int, int]) -> Path:
    """Events as stream, value, and when they were published and came (ms)."""
    path = folder / "events.jsonl"
    lines = [
        {"stream": stream, "data": {"v": v}, "stamp": BEGIN + at * MS, "arrived": BEGIN + came * MS}
        for stream, v, at, came in events
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


PUT_RIGHT = (
    ("/a", 1, 0, 0),
    ("/b", 1, 10, 10),
    ("/b", 2, 500, 500),
    ("/b", 1, 900, 900),
    ("/a", 2, 400, 1000),
    ("/b", 2, 1500, 1500),
)
"""The second cause comes 600 ms late: the violation at 500 ms does not stand."""
PUT_WRONG = (("/a", 1, 0, 0), ("/b", 1, 10, 10), ("/b", 1, 900, 900), ("/b", 3, 500, 1000), ("/b", 1, 1500, 1500))
"""An event without a cause comes late: a violation by itself."""


def report(spec: Path, events: Path, form: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """The exit status, and all that was said: what stood at first, and what was put right."""
    status = run_replay([spec], events, None, form, view="all")  # type: ignore[arg-type]
    return status, capsys.readouterr().out


def test_what_was_put_right_is_no_violation(spec: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    events = trace(tmp_path, *PUT_RIGHT)
    status, text = report(spec, events, "text", capsys)
    lines = text.splitlines()
    assert status == 0
    assert lines[0].startswith("violation: b_after_a does not hold at step 3 ")
    assert (
        lines[1] == "retracted: b_after_a is not violated at verdict #3: /a (topic 5 of replay) came 600 ms late (#6)"
    )
    assert "0 violations" in text
    status, text = report(spec, events, "junit", capsys)
    assert (status, ElementTree.fromstring(text).find(".//failure")) == (0, None)


def test_revisions_are_among_the_records(spec: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    events = trace(tmp_path, *PUT_RIGHT)
    _, text = report(spec, events, "jsonl", capsys)
    *records, summary = map(json.loads, text.splitlines())
    assert [r["outcome"] for r in records if r["kind"] != "revision"].count("currently_false") == 1
    (revision,) = [r for r in records if r["kind"] == "revision"]
    assert (revision["n"], revision["revises"], revision["retracted"]) == (6, {"from": 3, "to": 3}, True)
    assert summary["summary"]["violations"] == 0
    _, text = report(spec, events, "csv", capsys)
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [row["n"] for row in rows] == [str(record["n"]) for record in records]
    (row,) = [row for row in rows if row["kind"] == "revision"]
    assert (row["revises"], row["retracted"], row["outcome"]) == ("3 to 3", "true", "currently_true")
    assert row["because"] == "/a (topic 5 of replay) came 600 ms late"
    assert [row["released"] for row in rows if row["kind"] == "topic"] == [r["released"] for r in records if r["step"]]


def test_what_is_wrong_comes_late_too(spec: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    events = trace(tmp_path, *PUT_WRONG)
    status, text = report(spec, events, "text", capsys)
    assert status == 1
    assert sum(line.startswith("violation:") for line in text.splitlines()) == 1
    status, text = report(spec, events, "junit", capsys)
    failure = ElementTree.fromstring(text).find(".//failure")
    assert failure is not None
    assert failure.get("message", "").startswith("violated once")
    assert (failure.text or "").startswith("b_after_a does not hold at step ")
