"""`oracle-server replay`: the recorded traces, and what is no trace."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.naming import moment
from tests.whole.harness import COMMAND, PATIENCE, environment, failed, run

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "specs" / "battery_uav.yaml"
TRACES = ROOT / "examples" / "battery_uav" / "traces"
CORPUS = Path(__file__).parents[1] / "corpus"


def replayed(trace: Path, *options: str, status: int) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The records and the summary of a replay."""
    ended = run("replay", SPEC, trace, "--json", *options)
    assert (ended.returncode, ended.stderr) == (status, "")
    *records, last = map(json.loads, ended.stdout.splitlines())
    assert set(last) == {"summary"}
    return records, last["summary"]


def broken(summary: dict[str, Any]) -> dict[str, int]:
    """How often each property was violated, of those that were."""
    return {name: p["violations"] for name, p in summary["properties"].items() if p["violations"]}


PROPERTIES = {
    "status_matches_percentage",
    "input_is_followed_by_status",
    "request_has_a_cause",
    "change_is_followed_by_request",
    "response_has_a_request",
    "request_is_followed_by_response",
}


@pytest.mark.parametrize("by", ["publication", "arrival", "both"])
def test_a_sound_trace_breaks_nothing_in_any_order(by: str) -> None:
    records, summary = replayed(TRACES / "in_order.jsonl", "--by", by, status=0)
    orders = 2 if by == "both" else 1
    assert (summary["events"], summary["violations"], summary["late"]) == (334, 0, 0)
    assert len(summary["properties"]) == orders * len(PROPERTIES)
    for state in summary["properties"].values():
        assert (state["outcome"], state["first_violation"]) == ("currently_true", None)
    assert [r["n"] for r in records] == list(range(1, 334 * 6 * orders + 1))
    assert {r["outcome"] for r in records} == {"currently_true"}


def test_records_and_summary_are_shaped_as_agreed() -> None:
    records, summary = replayed(TRACES / "fault_wrong_status.jsonl", status=1)
    keys = "n step property order outcome stream kind monitor seq stamp arrived judged late skewed degraded decision"
    for record in records:
        assert {*keys.split(), "passed"} <= set(record)
        assert record["arrived"] <= record["judged"]
    assert set(summary["properties"]) == PROPERTIES
    assert {"events", "violations", "late", "properties"} <= set(summary)
    for state in summary["properties"].values():
        assert {"outcome", "first_violation"} <= set(state)


def test_a_shuffled_trace_is_judged_as_the_ordered_one() -> None:
    def told(trace: str) -> list[tuple[object, ...]]:
        records, _ = replayed(TRACES / f"{trace}.jsonl", "--by", "publication", status=0)
        return [(r["step"], r["stream"], r["kind"], r["stamp"], r["property"], r["outcome"]) for r in records]

    assert told("shuffled") == told("in_order")


def test_a_shuffled_trace_raises_false_alarms_by_arrival() -> None:
    records, summary = replayed(TRACES / "shuffled.jsonl", "--by", "arrival", status=1)
    alarms = [r for r in records if r["outcome"] == "currently_false"]
    assert len(alarms) == 18
    assert {r["property"] for r in alarms} == {"status_matches_percentage", "request_has_a_cause"}
    assert next(r["step"] for r in alarms) == 5
    (request,) = (r for r in alarms if r["property"] == "request_has_a_cause")
    assert (request["step"], request["stream"], request["kind"]) == (231, "/SetLED", "request")
    assert broken(summary) == {"status_matches_percentage": 16, "request_has_a_cause": 1}
    assert summary["properties"]["request_has_a_cause"]["first_violation"] == request["n"]


def test_both_orders_tell_a_slow_network_from_a_faulty_node() -> None:
    _, summary = replayed(TRACES / "shuffled.jsonl", "--by", "both", status=1)
    assert set(broken(summary)) == {"status_matches_percentage (arrival)", "request_has_a_cause (arrival)"}
    _, summary = replayed(TRACES / "fault_wrong_status.jsonl", "--by", "both", status=1)
    assert set(broken(summary)) == {"status_matches_percentage", "status_matches_percentage (arrival)"}


FAULTS = [
    (
        "fault_wrong_status",
        "status_matches_percentage",
        167,
        "/battery_status",
        "topic",
        {"id": "51"},
        ("51", 'topic: "/battery_percentage"'),
    ),
    (
        "fault_status_without_cause",
        "status_matches_percentage",
        168,
        "/battery_status",
        "topic",
        {"id": "0"},
        ("0", 'topic: "/input_accepted"'),
    ),
    (
        "fault_request_without_change",
        "request_has_a_cause",
        168,
        "/SetLED",
        "request",
        {"req_id": "51"},
        ("51", 'topic: "/battery_status"'),
    ),
    (
        "fault_silent_panel",
        "request_is_followed_by_response",
        300,
        "/LED_panel",
        "topic",
        {"id": "71"},
        ("61", 'service: "/SetLED", response: "True"'),
    ),
]


@pytest.mark.parametrize(("trace", "prop", "step", "stream", "kind", "signals", "missing"), FAULTS)
def test_each_fault_is_found_by_its_property_at_its_event(
    trace: str, prop: str, step: int, stream: str, kind: str, signals: dict[str, str], missing: tuple[str, str]
) -> None:
    records, summary = replayed(TRACES / f"{trace}.jsonl", status=1)
    assert broken(summary) == {prop: 1}
    (violation,) = (r for r in records if r["violation"])
    assert (violation["property"], violation["step"]) == (prop, step)
    assert (violation["stream"], violation["kind"], violation["outcome"]) == (stream, kind, "currently_false")
    assert signals.items() <= violation["explanation"]["event"]["signals"].items()
    assert violation["explanation"]["values"]["i"] == missing[0]
    cause, effect = violation["explanation"]["reasons"]
    assert cause["event"]["stamp"] < violation["arrived"]
    assert not effect["holds"]
    assert effect["text"].split(";")[0] == f"none in steps 1–{step}"  # noqa: RUF001
    assert effect["formula"].startswith(f"once {{{missing[1]}")
    assert summary["properties"][prop]["first_violation"] == violation["n"]
    text = run("replay", SPEC, TRACES / f"{trace}.jsonl")
    assert text.returncode == 1
    head, *table = text.stdout.splitlines()
    at = moment(violation["stamp"])
    assert head.startswith(f"violation: {prop} does not hold at step {step} ({at}), {stream} ")
    assert head.endswith(f" (#{violation['n']})")
    state = summary["properties"][prop]
    assert (state["first_violation_step"], state["first_violation_at"]) == (step, violation["stamp"])
    assert [line for line in table if line.startswith(f"{prop} ") and f"step {step}, {at}" in line]
    assert f"{summary['events']} events, 1 violation, 0 late" in table
    assert [line for line in table if line.startswith(f"{prop} ")]


def test_replay_of_a_sound_trace_as_text() -> None:
    ended = run("replay", SPEC, TRACES / "in_order.jsonl")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "violation " not in ended.stdout
    assert all(name in ended.stdout for name in PROPERTIES)


def test_replay_of_an_empty_trace(tmp_path: Path) -> None:
    (tmp_path / "empty.jsonl").write_text("")
    ended = run("replay", SPEC, tmp_path / "empty.jsonl", "--json")
    assert ended.returncode == 2
    assert "has no event at all" in ended.stderr
    (last,) = map(json.loads, ended.stdout.splitlines())
    assert (last["summary"]["events"], last["summary"]["exit"]) == (0, 2)


def test_replay_into_a_pipe_that_closes_early(tmp_path: Path) -> None:
    """It says neither that something was violated nor that nothing was."""
    trace = tmp_path / "trace.jsonl"
    trace.write_text((TRACES / "in_order.jsonl").read_text() * 2_000)
    command: list[str | Path] = [COMMAND, "replay", SPEC, trace, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment()) as process:
        assert process.stdout
        assert process.stderr
        assert json.loads(process.stdout.readline())["n"] == 1
        process.stdout.close()
        said = process.stderr.read()
        status = process.wait(PATIENCE)
    assert (said, status) == (b"", 141)


EXPECTED: dict[str, str] = json.loads((CORPUS / "traces" / "expected.json").read_text())


@pytest.mark.parametrize("name", EXPECTED)
def test_a_malformed_trace_is_refused_with_its_line(name: str) -> None:
    line = failed("replay", SPEC, CORPUS / "traces" / name)
    assert line.startswith(f"oracle-server: {CORPUS / 'traces' / name}{EXPECTED[name]}")


def test_the_corpus_of_traces_is_all_expected() -> None:
    assert {path.name for path in (CORPUS / "traces").glob("*.jsonl")} == set(EXPECTED)


def test_arguments_in_the_wrong_order_are_told(tmp_path: Path) -> None:
    trace, other = TRACES / "in_order.jsonl", TRACES / "shuffled.jsonl"
    line = failed("replay", trace, SPEC)
    stands = f"{trace}: is a recording, and stands where a spec is expected; "
    assert line == f"oracle-server: {stands}write `replay {SPEC} {trace}`"
    assert failed("replay", trace, SPEC, SPEC).endswith(f"write `replay {SPEC} {SPEC} {trace}`")
    assert failed("replay", SPEC, trace, SPEC).endswith(f"write `replay {SPEC} {SPEC} {trace}`")
    assert failed("replay", SPEC, trace, other) == (
        f"oracle-server: {trace}: is a recording, and stands where a spec is expected: `replay SPEC… RECORDING`; "
        "many recordings: `replay RECORDING… --on SPEC…`"
    )
    assert failed("replay", trace, other, SPEC).endswith("many recordings: `replay RECORDING… --on SPEC…`")
    assert "is a spec, and stands where" in failed("replay", tmp_path, SPEC)
    (tmp_path / "metadata.yaml").touch()
    assert failed("replay", tmp_path, SPEC).startswith(f"oracle-server: {tmp_path}: is a recording, and stands")
    line = failed("replay", SPEC, tmp_path / "metadata.yaml")
    assert line == f"oracle-server: {tmp_path / 'metadata.yaml'}: is the metadata of a bag; name its folder: {tmp_path}"
    assert failed("replay", SPEC, SPEC) == (
        f"oracle-server: {SPEC}: is a spec, and stands where the recording is expected: `replay SPEC… RECORDING`"
    )
    as_json = tmp_path / "spec.yaml"  # which YAML contains
    as_json.write_text('{"id": "a", "streams": [{"topic": "/a"}], "properties": [{"id": "p", "formula": "{v: 1}"}]}')
    assert "has no event of a" in run("replay", as_json, trace).stderr


def test_replay_of_what_can_not_be_used(tmp_path: Path) -> None:
    assert "nowhere.jsonl" in failed("replay", SPEC, "nowhere.jsonl")
    assert "nowhere.yaml:1:1" in failed("replay", "nowhere.yaml", TRACES / "in_order.jsonl")
    assert "trace.txt" in failed("replay", SPEC, "trace.txt")
    (tmp_path / "folder.jsonl").mkdir()
    assert "folder.jsonl" in failed("replay", SPEC, tmp_path / "folder.jsonl")
    assert "sideways" in failed("replay", SPEC, TRACES / "in_order.jsonl", "--by", "sideways")
    (tmp_path / "bad.yaml").write_text(SPEC.read_text() + "colour: red\n")
    assert "unknown key 'colour'" in failed("replay", tmp_path / "bad.yaml", TRACES / "in_order.jsonl")


def test_a_recording_is_not_read_from_a_pipe() -> None:
    """What it begins with would be gone once it is known what it is, and judged without a word."""
    trace = TRACES / "fault_wrong_status.jsonl"
    piped = subprocess.run(
        [COMMAND, "replay", SPEC, "/dev/stdin"], input=trace.read_bytes(), capture_output=True, timeout=2 * PATIENCE,
        env=environment(), check=False,
    )  # fmt: skip
    told = b"oracle-server: /dev/stdin: is no file, and a recording is read more than once: write it to one first\n"
    assert (piped.returncode, piped.stdout, piped.stderr) == (2, b"", told)


def test_a_spec_may_be_read_from_a_pipe() -> None:
    trace = TRACES / "fault_wrong_status.jsonl"
    for words in (("/dev/stdin", trace), (trace, "--on", "/dev/stdin")):
        piped = subprocess.run(
            [COMMAND, "replay", *words, "--format", "jsonl"], input=SPEC.read_bytes(), capture_output=True,
            timeout=2 * PATIENCE, env=environment(), check=False,
        )  # fmt: skip
        assert (piped.returncode, piped.stderr) == (1, b""), piped
