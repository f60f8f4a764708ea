"""How a replay ends: 0 means judged and nothing violated, and whatever was not judged is said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import SpecError
from oracle_server.core.expression import no_signal
from oracle_server.replay.command import run_replay
from oracle_server.replay.conclusion import gravest
from tests.replay.judging import exit_of, judge, write_numbers, write_spec

SPEC = """
id: two
ordering: {by: arrival}
streams:
  - {topic: /battery, signals: {level: msg.level}}
  - {topic: /mode, signals: {mode: msg.mode, extra: msg.extra}}
properties:
  - {id: charged, formula: '{topic: "/battery"} -> {level >= 20}'}
  - {id: known, formula: '{topic: "/mode"} -> {mode: *}'}
"""


def trace(folder: Path, *events: tuple[str, dict[str, Any]]) -> Path:
    path = folder / "trace.jsonl"
    lines = [{"stream": name, "stamp": n, "arrived": n, "data": data} for n, (name, data) in enumerate(events, 1)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


FULL: dict[str, Any] = {"mode": "auto", "extra": 1}
CASES: dict[str, tuple[list[tuple[str, dict[str, Any]]], int, int, str]] = {
    "all is judged": ([("/battery", {"level": 50}), ("/mode", FULL)], 0, 0, ""),
    "something is violated": ([("/battery", {"level": 5}), ("/mode", FULL)], 1, 1, ""),
    "a stream is silent": ([("/battery", {"level": 50})], 0, 3, "/mode: no event in the recording"),
    "a name is nearly there": (
        [("/battery", {"level": 50}), ("/mod", {})],
        0,
        3,
        "/mode: no event in the recording; it has /mod",
    ),
    "it is in another namespace": (
        [("/battery", {"level": 50}), ("/robots/alpha/mode", {}), ("/mod", {})],
        0,
        3,
        "/mode: no event in the recording; it has /robots/alpha/mode",
    ),
    "a signal is never there": (
        [("/battery", {"level": 50}), ("/mode", {"mode": "auto"})],
        0,
        3,
        "/mode: the signal extra was absent at its only event",
    ),
    "a step is unknown": (
        [("/battery", {"level": 50}), ("/mode", FULL), ("/battery", {"level": "NaN"})],
        0,
        3,
        "charged: unknown at 1 step",
    ),
    "violated and unknown": ([("/battery", {"level": 5}), ("/battery", {"level": "NaN"})], 1, 1, "unknown at 1 step"),
    "nothing is observed": (
        [("/batery", {"level": 50}), ("/batery", {"level": 50}), ("/x", {})],
        2,
        2,
        "which observes /battery, /mode; it has /batery (2 events), /x (1 event)",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_exit_status_says_whether_it_was_judged(case: str, tmp_path: Path) -> None:
    events, plain, strict, said = CASES[case]
    found = judge(write_spec(tmp_path, SPEC), trace(tmp_path, *events))
    assert (found.exit, found.strict) == (plain, strict)
    assert said in found.said
    if case == "all is judged":
        assert found.said == ""


def test_a_property_that_was_always_unknown_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, SPEC)
    events = trace(tmp_path, *[("/battery", {"level": "NaN"})] * 3)
    found = judge(spec, events)
    reason = f"the signal level of /battery failed at 3 of 3 events: msg.level is {no_signal('NaN')}"
    assert (found.exit, found.strict) == (3, 3)
    assert found.summary["unjudged"] == [{"property": "charged", "reason": reason}]
    assert exit_of(spec, events) == 3
    assert f"charged was not judged: {reason}" in capsys.readouterr().out
    run_replay([spec], events, None, "junit")
    suite = ElementTree.fromstring(capsys.readouterr().out).find("testsuite")
    assert suite is not None
    error = suite.find("testcase[@name='charged']/error")
    assert error is not None
    assert error.get("message") == f"3 steps could not be judged: {reason}"
    assert "/mode: no event in the recording" in (suite.findtext("system-out") or "")


UNKNOWN = [("/battery", {"level": "NaN"})] * 3
VACUOUS: dict[str, tuple[list[tuple[str, dict[str, Any]]], int]] = {
    "an event of another stream": ([*UNKNOWN, ("/mode", FULL)], 3),
    "an event that lacks its signal": ([*UNKNOWN, ("/battery", {})], 3),
    "both": ([("/mode", FULL), *UNKNOWN, ("/battery", {"level": None}), ("/mode", FULL)], 3),
    "one that was judged": ([*UNKNOWN, ("/battery", {"level": 50}), ("/mode", FULL)], 0),
}


@pytest.mark.parametrize("case", VACUOUS)
def test_what_holds_for_want_of_its_signals_was_not_judged(case: str, tmp_path: Path) -> None:
    events, status = VACUOUS[case]
    text = SPEC.replace("-> {level >= 20}'", "and {level < 20} -> {level > 10}'")
    found = judge(write_spec(tmp_path, text), trace(tmp_path, *events))
    assert (found.exit, found.strict) == (status, 3)
    if status:
        (unjudged,) = found.summary["unjudged"]
        assert unjudged["property"] == "charged"
        assert "the signal level of /battery failed at 3 of" in unjudged["reason"]


def test_what_was_violated_was_judged(tmp_path: Path) -> None:
    text = SPEC.replace('{topic: "/battery"} -> {level >= 20}', '{topic: "/mode"} -> once {level >= 20}')
    found = judge(write_spec(tmp_path, text), trace(tmp_path, *UNKNOWN, ("/mode", FULL)))
    assert (found.exit, found.summary["unjudged"]) == (1, [])
    assert "charged: unknown at 3 steps" in found.said


def test_what_reads_a_held_signal_is_judged_at_the_events_where_it_matters(tmp_path: Path) -> None:
    text = SPEC.replace("topic: /battery,", "topic: /battery, hold: [level],")
    text = text.replace('{topic: "/battery"} -> {level >= 20}', '{topic: "/mode", level < 20} -> {mode: rest}')
    found = judge(write_spec(tmp_path, text), trace(tmp_path, *UNKNOWN, ("/mode", FULL), ("/battery", {"level": 5})))
    assert (found.exit, found.strict) == (3, 3)
    (unjudged,) = found.summary["unjudged"]
    assert unjudged["property"] == "charged"
    assert unjudged["reason"].startswith("unknown at every event of /mode: the signal level of /battery failed at 3 of")


JUNIT = {**CASES, "never judged": ([*UNKNOWN, ("/mode", FULL)], 3, 3, "")}


@pytest.mark.parametrize("strict", [False, True])
@pytest.mark.parametrize("case", JUNIT)
def test_junit_says_what_the_exit_status_says(
    case: str, strict: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    events, plain, exit_strict, _ = JUNIT[case]
    status = run_replay([write_spec(tmp_path, SPEC)], trace(tmp_path, *events), None, "junit", strict=strict)
    assert status == (exit_strict if strict else plain)
    suite = ElementTree.fromstring(capsys.readouterr().out).find("testsuite")
    assert suite is not None
    found = {kind: len(suite.findall(f"testcase/{kind}")) for kind in ("failure", "error")}
    assert found == {"failure": int(suite.get("failures", "")), "error": int(suite.get("errors", ""))}
    assert int(suite.get("tests", "")) == len(suite.findall("testcase"))
    assert bool(found["failure"]) == (status == 1)
    assert bool(found["failure"] or found["error"]) == (status != 0)


def test_junit_names_what_a_strict_replay_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, events = write_spec(tmp_path, SPEC), trace(tmp_path, ("/battery", {"level": 50}))
    run_replay([spec], events, None, "junit", strict=True)
    suite = ElementTree.fromstring(capsys.readouterr().out).find("testsuite")
    assert suite is not None
    error = suite.find("testcase[@name='(recording)']/error")
    assert error is not None
    lacking = "/mode: no event in the recording"
    assert error.get("message") == f"not everything was judged, and --strict was given: {lacking}"
    assert error.text == lacking


def test_junit_errs_where_nothing_was_observed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_replay([write_spec(tmp_path, SPEC)], trace(tmp_path, ("/x", {})), None, "junit") == 2
    report = capsys.readouterr()
    suite = ElementTree.fromstring(report.out).find("testsuite")
    assert suite is not None
    assert (suite.get("tests"), suite.get("errors")) == ("2", "2")
    assert "has no event of two" in report.err


def test_signals_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, SPEC)
    levels: list[Any] = [50, "NaN", None, 40]
    events = trace(tmp_path, *[("/battery", {"level": level}) for level in levels], ("/mode", FULL))
    summary = judge(spec, events).summary
    assert summary["streams"]["/battery"] == {
        "events": 4,
        "signals": {"level": {"present": 2, "absent": 1, "failed": 1, "reason": f"msg.level is {no_signal('NaN')}"}},
    }
    run_replay([spec], events, None, "text")
    short = capsys.readouterr().out
    assert f"/battery: the signal level failed at 1 of 4 events: msg.level is {no_signal('NaN')}" in short
    assert "present" not in short
    run_replay([spec], events, None, "text", signals=True)
    assert "present" in capsys.readouterr().out


def test_the_first_reason_of_a_failed_signal_is_told(tmp_path: Path) -> None:
    spec = write_spec(tmp_path, SPEC.replace("extra: msg.extra", "extra: 1 / msg.extra"))
    events = trace(tmp_path, *[("/mode", {"mode": "a", "extra": extra}) for extra in (2, 0, "x")])
    found = judge(spec, events)
    assert found.summary["streams"]["/mode"]["signals"]["extra"]["reason"] == "msg.extra is 0: division by zero"


def test_types_of_the_folders_hold_for_the_spec(tmp_path: Path) -> None:
    (tmp_path / "pkg" / "msg").mkdir(parents=True)
    (tmp_path / "pkg" / "msg" / "Mode.msg").write_text("string mood\n")
    spec = write_spec(tmp_path, SPEC.replace("topic: /mode,", "topic: /mode, type: pkg/msg/Mode,"))
    with pytest.raises(SpecError, match="pkg/msg/Mode has no field `mode`"):
        run_replay([spec], trace(tmp_path, ("/mode", FULL)), None, "text", [tmp_path / "pkg"])


def test_the_gravest_status_stands_for_several() -> None:
    assert [gravest(list(s)) for s in ((), (0, 3), (3, 1), (1, 2, 0), (0, 0))] == [0, 3, 1, 2, 0]


def test_csv_has_the_reasons_on_standard_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec, events = write_spec(tmp_path, SPEC), trace(tmp_path, ("/battery", {"level": 50}))
    assert run_replay([spec], events, None, "csv", strict=True) == 3
    assert "oracle-server: two: /mode: no event in the recording" in capsys.readouterr().err


def test_what_a_recording_is_shows_in_its_content(tmp_path: Path) -> None:
    spec = write_spec(tmp_path, SPEC)
    log = tmp_path / "log.txt"  # as ROSMonitoring names it
    log.write_text(
        '{"topic": "battery", "time": 1.5, "level": 50}\n{"topic": "mode", "time": 2, "mode": "a", "extra": 1}\n'
    )
    assert judge(spec, log).summary["events"] == 2
    text = SPEC.replace("{level: msg.level}", "{level: msg.data}").replace("topic: /battery", "topic: /level")
    bag = write_numbers(tmp_path / "bag", {"/level": [(1, 50.0)]}, StoragePlugin.SQLITE3)
    (file,) = bag.glob("*.db3")
    named = file.rename(tmp_path / "flight.backup")
    assert (
        judge(write_spec(tmp_path, text.replace('topic: "/battery"', 'topic: "/level"')), named).summary["events"] == 1
    )


VACUOUS_SPEC = SPEC.replace("'{topic: \"/mode\"} -> {mode: *}'", "'{mode: idle} or {kind: topic}'")
UNWRITTEN_SPEC = SPEC.replace("extra: msg.extra", "extra: todo()").replace("{mode: *}", "{extra: *}")
WARNED = {
    "vacuous": (VACUOUS_SPEC, "formula of 'known': it holds at every event, whatever the messages say", 0),
    "unwritten": (UNWRITTEN_SPEC, "'extra' is still to be written", 3),
}


@pytest.mark.parametrize("form", ["text", "jsonl", "csv", "junit"])
@pytest.mark.parametrize("case", WARNED)
def test_warnings_of_formulas_are_said_and_are_no_strict_success(
    case: str, form: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, warning, plain = WARNED[case]
    spec, events = write_spec(tmp_path, text), trace(tmp_path, ("/battery", {"level": 50}), ("/mode", FULL))
    for strict in (False, True):
        assert run_replay([spec], events, None, form, strict=strict) == (3 if strict else plain)
        said = capsys.readouterr()
        line = next(line for line in said.err.splitlines() if warning in line)
        assert line.startswith(f"oracle-server: {spec}:")
        assert "warning: " in line
        assert said.err.count(warning) == 1
        assert ("because of --strict" in said.err) == (strict and not plain)
        if form == "jsonl":
            (found,) = json.loads(said.out.splitlines()[-1])["summary"]["warnings"]
            assert warning in found
        if form == "junit":
            suite = ElementTree.fromstring(said.out).find("testsuite")
            assert suite is not None
            assert warning in (suite.findtext("system-out") or "")
            assert (suite.find("testcase[@name='(recording)']/error") is not None) == strict


def test_warnings_of_types_are_for_check_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = SPEC.replace("topic: /mode,", "topic: /mode, type: unknown_msgs/msg/Mode,")
    events = trace(tmp_path, ("/battery", {"level": 50}), ("/mode", FULL))
    assert run_replay([write_spec(tmp_path, text)], events, None, "text", strict=True) == 0
    assert capsys.readouterr().err == ""


def test_a_spec_may_ask_for_two_spellings(tmp_path: Path) -> None:
    text = SPEC.replace("{mode: *}", "{mode: idle} or {mode: IDLE}")
    events = trace(tmp_path, ("/battery", {"level": 50}), ("/mode", {**FULL, "mode": "idle"}))
    assert run_replay([write_spec(tmp_path, text)], events, None, "text", strict=True) == 0


def test_a_formula_over_numbers_begins_where_all_its_signals_have_been_there(tmp_path: Path) -> None:
    streams = "{topic: /battery, signals: {level: msg.level}, hold: [level]}, {topic: /mode, signals: {mode: msg.mode}}"
    text = f"id: a\nstreams: [{streams}]\nproperties:\n  - {{id: p, formula: level > 20, engine: rtamt}}\n"
    spec = write_spec(tmp_path, text)
    found = judge(spec, trace(tmp_path, ("/mode", FULL), ("/battery", {"level": 50}), ("/mode", FULL)))
    assert (found.exit, found.strict, found.summary["doubts"]) == (0, 0, [])
    assert found.said == "p: judged from step 2 on, and unknown before"
    found = judge(spec, trace(tmp_path, ("/mode", FULL), ("/mode", FULL)))
    assert (found.exit, found.strict) == (3, 3)


STRANGE: dict[str, tuple[str, list[dict[str, Any]], str]] = {
    "numbers as texts": (
        "not {level < 20}",
        [{"data": {"level": "9"}}],
        "/battery: the signal level was always a text, and p compares it with a number",
    ),
    "another spelling": (
        'not {level: "Low"}',
        [{"data": {"level": "LOW"}}, {"data": {"level": "FULL"}}],
        'p compares level with "Low", which it never was: it was "LOW"',
    ),
    "a frame with a slash": (
        '{topic: /battery} -> {level != "/map"}',
        [{"data": {"level": "map"}}],
        'p compares level with "/map", which it never was: it was "map"',
    ),
    "a request on a topic": (
        "{topic: /battery} -> {level >= 20}",
        [{"data": {"level": 50}}, {"kind": "request", "data": {"level": 9}}],
        "/battery: 1 event of the kind `request`, and the spec has another one there",
    ),
    "events that were lost": (
        "{topic: /battery} -> {level >= 20}",
        [{"data": {"level": 50}, "lost": 3}],
        "3 events lost while it was recorded",
    ),
}


@pytest.mark.parametrize("case", STRANGE)
def test_what_else_was_not_judged_is_no_strict_success(case: str, tmp_path: Path) -> None:
    formula, events, said = STRANGE[case]
    text = "id: a\nstreams: [{topic: /battery, signals: {level: msg.level}}]\nproperties:\n"
    spec = write_spec(tmp_path, f"{text}  - {{id: p, formula: '{formula}'}}\n")
    path = tmp_path / "trace.jsonl"
    lines = [{"stream": "/battery", "arrived": n, **event} for n, event in enumerate(events, 1)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(spec, path)
    assert (found.exit, found.strict) == (0, 3)
    assert said in found.said


@pytest.mark.parametrize(
    "formula", ["not ({v: 3} or {v: '3'})", "{v: *} -> not {v: '3'}", "not exists[x]. {v: *x, v: a}"]
)
def test_a_signal_may_be_compared_with_several_kinds(formula: str, tmp_path: Path) -> None:
    quoted = formula.replace("'", '"')
    text = f"id: a\nstreams: [{{topic: /a, signals: {{v: msg.v}}}}]\nproperties: [{{id: p, formula: '{quoted}'}}]\n"
    found = judge(write_spec(tmp_path, text), trace(tmp_path, ("/a", {"v": 4})))
    assert (found.exit, found.strict, found.said) == (0, 0, "")


def test_events_that_are_skipped_are_no_strict_success(tmp_path: Path) -> None:
    text = SPEC.replace("ordering: {by: arrival}", "ordering: {late: skip}")
    second = 10**9
    lines = [
        {"stream": "/battery", "arrived": (100 + n) * second, "stamp": (100 - n) * second, "data": {"level": level}}
        for n, level in enumerate((50, 5))
    ]
    path = tmp_path / "trace.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(write_spec(tmp_path, text), path)
    assert (found.exit, found.strict) == (0, 3)
    assert "1 late event was skipped, and not judged" in found.said


def test_deadlines_that_no_time_reaches_are_no_strict_success(tmp_path: Path) -> None:
    text = SPEC.replace("{id: known,", "{id: known, time: seconds,")
    path = tmp_path / "trace.jsonl"
    events = [("/battery", {"level": 50}), ("/mode", FULL)]
    lines = [{"stream": name, "stamp": n, "data": data} for n, (name, data) in enumerate(events, 1)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(write_spec(tmp_path, text), path)
    assert (found.exit, found.strict) == (0, 3)
    assert "no deadline of known was judged by itself: the recording has no times of arrival" in found.said


@pytest.mark.parametrize("type_", ["", "type: std_msgs/msg/Bool"], ids=["of no known type", "of a known type"])
def test_a_stream_without_signals_does_not_lack_what_others_declare(type_: str, tmp_path: Path) -> None:
    streams = f"[{{topic: /stop, {type_}}}, {{topic: /cmd, signals: {{v: msg.v}}}}]"
    formulas = "[{id: p, formula: '{topic: /stop} -> {data: false}'}, {id: q, formula: '{topic: /cmd} -> {v < 2}'}]"
    spec = f"id: s\nordering: {{by: arrival}}\nstreams: {streams}\nproperties: {formulas}\n"
    events = trace(tmp_path, ("/stop", {"data": False}), ("/cmd", {"v": 1}))
    assert run_replay([write_spec(tmp_path, spec)], events, None, "text", strict=True) == 0
    lacking = trace(tmp_path, ("/stop", {}), ("/cmd", {"v": 1}))
    assert run_replay([write_spec(tmp_path, spec)], lacking, None, "text", strict=True) != 0


def test_a_message_whose_rows_have_all_signals_lacks_nothing(tmp_path: Path) -> None:
    each, signals = "each: msg.name, ", "{joint: 'item', effort: 'has(msg.effort) ? msg.effort[index] : 0.0'}"
    spec = "id: s\nstreams:\n  - {topic: /js, type: sensor_msgs/msg/JointState, EACHsignals: SIGNALS}\n"
    spec += "properties:\n  - {id: p, formula: 'not {effort > 1}'}\n"
    recording = trace(tmp_path, ("/js", {"name": ["a", "b"], "position": [1.0, 2.0], "velocity": [1.0, 2.0]}))
    for rows in (False, True):
        own = signals if rows else signals.replace("item", "msg.name[0]").replace("index", "0")
        text = spec.replace("EACH", each if rows else "").replace("SIGNALS", own)
        assert run_replay([write_spec(tmp_path, text)], recording, None, "text", strict=True) == 0
    lacking = spec.replace("EACH", each).replace("SIGNALS", "{joint: 'item', effort: 'msg.effort[index]'}")
    assert run_replay([write_spec(tmp_path, lacking)], recording, None, "text", strict=True) == 3
