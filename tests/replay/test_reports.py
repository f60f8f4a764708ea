"""What `replay` prints: every format, several specs, and old verdicts compared."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.replay.judging import exit_of
from tests.whole.harness import run

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "specs" / "battery_uav.yaml"
TRACES = ROOT / "examples" / "battery_uav" / "traces"
ODD = """
id: odd
ordering: {by: arrival}
streams: [{topic: /a, signals: {v: msg.v}}]
properties:
  - {id: low, formula: '{topic: "/a"} -> {v < 5}'}
  - {id: broken & "quoted" < name, formula: '{v: *}'}
""".replace('broken & "quoted" < name', "any")


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    path = tmp_path / "odd.yaml"
    path.write_text(ODD)
    return path


def test_csv_has_a_row_for_each_record() -> None:
    trace = TRACES / "fault_wrong_status.jsonl"
    *records, _ = map(json.loads, run("replay", SPEC, trace, "--json").stdout.splitlines())
    ended = run("replay", SPEC, trace, "--format", "csv")
    assert ended.returncode == 1
    rows = list(csv.DictReader(io.StringIO(ended.stdout)))
    assert len(rows) == len(records)
    for row, record in zip(rows, records, strict=True):
        assert row["spec"] == "battery_uav"
        for key in ("n", "step", "property", "outcome", "stream", "kind", "stamp", "arrived"):
            assert row[key] == str(record[key])
        assert row["violation"] == str(record["violation"]).lower()
        assert row["explanation"] == (record["explanation"]["text"] if record["violation"] else "")


@pytest.mark.parametrize("format_", ["text", "junit"])
def test_obligations_that_are_open_at_the_end_are_told(format_: str, tmp_path: Path) -> None:
    spec, trace = tmp_path / "spec.yaml", tmp_path / "trace.jsonl"
    spec.write_text(
        "id: s\nordering: {by: arrival}\nstreams: [{topic: /a, signals: {v: msg.v}}]\n"
        "properties: [{id: answered, formula: '{v: 1} -> eventually[:60] {v: 2}'}]\n"
    )
    lines = [{"stream": "/a", "stamp": i, "data": {"v": v}} for i, v in enumerate((1, 2, 1, 1), start=1)]
    trace.write_text("".join(json.dumps(line) + "\n" for line in lines))
    ended = run("replay", spec, trace, "--format", format_)
    assert ended.returncode == 0
    text = ended.stdout
    if format_ == "junit":
        text = ElementTree.fromstring(text).findtext("testsuite/system-out") or ""
    assert "answered: 2 obligations still open at the end" in text.splitlines()


def test_junit_fails_what_was_violated_and_errs_where_nothing_was_judged(odd: Path, tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"
    lines = [{"stream": "/a", "stamp": i, "data": {"v": v}} for i, v in enumerate((1, "NaN", 9, 2, 9), start=1)]
    trace.write_text("".join(json.dumps(line) + "\n" for line in lines))
    ended = run("replay", SPEC, odd, trace, "--format", "junit")
    assert ended.returncode == 2, "one of the recordings has no event of its spec"
    tree = ElementTree.fromstring(ended.stdout)
    suites = {suite.get("name"): suite for suite in tree.iter("testsuite")}
    assert set(suites) == {"battery_uav", "odd"}
    uav, own = suites["battery_uav"], suites["odd"]
    assert (uav.get("tests"), uav.get("errors")) == ("6", "6"), "nothing of its streams is in the trace"
    assert (own.get("failures"), own.get("errors")) == ("1", "0")
    failure = own.find("testcase[@name='low']/failure")
    assert failure is not None
    assert "violated 2 times in 1 episode, first at" in failure.get("message", "")
    (line,) = (failure.text or "").splitlines()
    assert "low does not hold at step 3" in line
    assert "; 2 violations until " in line
    assert own.find("testcase[@name='any']/error") is None, "it was judged at the other steps"
    assert "any: unknown at 1 step" in (own.findtext("system-out") or "").splitlines()


def test_several_specs_are_told_apart(odd: Path) -> None:
    trace = TRACES / "shuffled.jsonl"
    by_arrival = run("replay", SPEC, odd, trace, "--json", "--by", "arrival")
    assert by_arrival.returncode == 2
    lines = [json.loads(line) for line in by_arrival.stdout.splitlines()]
    summaries = {line["summary"]["spec"]: line["summary"] for line in lines if "summary" in line}
    assert summaries["battery_uav"]["violations"] == 17
    assert (summaries["odd"]["events"], summaries["odd"]["ignored"]) == (0, 334)
    assert {line["spec"] for line in lines if "n" in line} == {"battery_uav"}
    text = run("replay", SPEC, odd, trace)
    assert (text.returncode, text.stdout.count("== ")) == (2, 2)
    (line,) = [line for line in text.stderr.splitlines() if "no event of odd" in line]
    assert "which observes /a; it has " in line
    assert "/battery_percentage (" in line


OLD = [
    ({"topic": "a", "time": 1.5, "v": 1, "verdict": "currently_true"}, None),
    ({"topic": "a", "time": 2.5, "v": 9, "verdict": "true"}, ("true", "violated", ["low"])),
    ({"topic": "a", "time": 3.5, "v": 9, "verdict": "false"}, None),
    ({"topic": "a", "time": 4.5, "v": 1, "verdict": "currently_false"}, ("currently_false", "satisfied", [])),
    ({"topic": "a", "time": 5.5, "v": 1, "verdict": "no idea"}, ("no idea", "unknown", [])),
]


def test_old_verdicts_are_compared_and_differences_listed(odd: Path, tmp_path: Path) -> None:
    trace = tmp_path / "log.jsonl"
    trace.write_text("".join(json.dumps(event) + "\n" for event, _ in OLD))
    ended = run("replay", odd, trace, "--json")
    lines = [json.loads(line) for line in ended.stdout.splitlines()]
    found = [line["difference"] for line in lines if "difference" in line]
    assert [(d["seq"], d["was"], d["now"], d["properties"]) for d in found] == [
        (2, "true", "violated", ["low"]),
        (4, "currently_false", "satisfied", []),
        (5, "no idea", "satisfied", []),
    ]
    assert (lines[-1]["summary"]["compared"], lines[-1]["summary"]["differing"]) == (5, 3)
    text = run("replay", odd, trace).stdout
    assert "difference: /a 2 was 'true', is violated (low)" in text
    assert "5 compared with old verdicts, 3 differ" in text


def test_bare_old_events_have_nothing_to_compare(odd: Path, tmp_path: Path) -> None:
    trace = tmp_path / "log.jsonl"
    trace.write_text("".join(json.dumps({k: v for k, v in e.items() if k != "verdict"}) + "\n" for e, _ in OLD))
    ended = run("replay", odd, trace, "--json")
    assert "compared" not in json.loads(ended.stdout.splitlines()[-1])["summary"]


def test_a_violation_by_a_late_event_says_so(odd: Path, tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"
    second = 10**9
    lines = [
        {"stream": "/a", "arrived": arrived * second, "stamp": stamp * second, "data": {"v": v}}
        for arrived, stamp, v in ((100, 100, 1), (105, 105, 1), (106, 101, 9))
    ]
    trace.write_text("".join(json.dumps(line) + "\n" for line in lines))
    said = run("replay", odd, trace, "--by", "publication").stdout
    assert "low does not hold at step 3 (101.000 s), /a (topic 3 of replay), which came late: " in said
    assert "late: " not in run("replay", odd, trace, "--by", "arrival").stdout


@pytest.mark.parametrize("bad", ["a recording that is not there", "a line that is no event", "an unsound spec"])
def test_a_ci_is_told_why_an_input_can_not_be_used(bad: str, odd: Path, tmp_path: Path) -> None:
    """The file was empty, which a CI can't read."""
    trace, spec = tmp_path / "trace.jsonl", tmp_path / "second.yaml"
    lines = [json.dumps({"stream": "/a", "stamp": i, "data": {"v": 7}}) for i in range(1, 4)]
    trace.write_text("\n".join([*lines, "broken"] if bad.startswith("a line") else lines) + "\n")
    spec.write_text(ODD.replace("odd", "second").replace("v < 5", "v <" if bad == "an unsound spec" else "v < 5"))
    recording = tmp_path / "none.bag" if bad.startswith("a recording") else trace
    ended = run("replay", odd, spec, recording, "--format", "junit")
    assert ended.returncode == 2
    (suite,) = ElementTree.fromstring(ended.stdout).findall("testsuite")
    (error,) = suite.findall("testcase[@name='(recording)']/error")
    assert (suite.get("tests"), suite.get("errors")) == ("1", "1")
    (why,) = ended.stderr.splitlines()
    assert error.get("message") == why.removeprefix("oracle-server: ")
    annotated = run("replay", odd, spec, recording, "--format", "github")
    assert (annotated.returncode, annotated.stdout) == (2, f"::error::{error.get('message')}\n")


def test_of_many_streams_that_no_spec_observes_the_busiest_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (spec := tmp_path / "spec.yaml").write_text(
        "id: s\nstreams: [{topic: /a}]\nproperties: [{id: p, formula: '{v: 1}'}]"
    )
    events = [("a", 1), *((f"t{n}", 1 + (n == 9)) for n in range(22))]
    lines = [{"topic": name, "time": 1, "v": 1} for name, count in events for _ in range(count)]
    (log := tmp_path / "log.txt").write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert exit_of(spec, log) == 0
    told = [line.removeprefix("oracle-server: ignored ") for line in capsys.readouterr().err.splitlines()]
    assert len(told) == 21
    assert "2 events of 't9', which s does not observe" in told
    assert told[-1] == "2 events of 2 other streams, which s does not observe"
