"""The command line, run as its users run it."""

from __future__ import annotations

import json
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.server.client import BASE, attached, make_event
from tests.server.conftest import copy_specs
from tests.server.harness import COMMAND, PATIENCE, Server, environment, run

ROOT = Path(__file__).parents[1]
SPEC = ROOT / "specs" / "battery_uav.yaml"
TRACES = ROOT / "examples" / "battery_uav" / "traces"
CORPUS = Path(__file__).parent / "corpus"

SOUND = """\
id: sound
streams:
  - topic: /a
properties:
  - id: p
    formula: 'not {topic: "/a", v: 7}'
"""


def failed(*arguments: str | Path, **settings: str) -> str:
    """What a command says that can't do what it is asked: one line, and nothing else."""
    ended = run(*arguments, **settings)
    assert ended.returncode == 2, ended
    (line,) = ended.stderr.splitlines()
    assert line.startswith("oracle-server: ")
    return line


# check


def test_check_of_sound_specs() -> None:
    ended = run("check", *sorted((ROOT / "specs").glob("*.yaml")))
    assert (ended.returncode, ended.stderr) == (0, "")
    assert f"{SPEC}: sound" in ended.stdout


def test_check_tells_each_finding_with_its_place(tmp_path: Path) -> None:
    bad, good = tmp_path / "bad.yaml", tmp_path / "good.yaml"
    bad.write_text(
        "id: bad\n"
        "streams:\n"
        "  - topic: /a\n"
        "    signals: {v: msg.v}\n"
        "properties:\n"
        "  - id: p\n"
        "    formula: |\n"
        '      {topic: "/a"} ->\n'
        "        once{w: 7}\n"
        "  - id: q\n"
        "    formula: 'once{topic: \"/b\"}'\n"
        "    guards: [/a]\n"
    )
    good.write_text(SOUND)
    ended = run("check", bad, good, tmp_path / "nowhere.yaml")
    assert ended.returncode == 1
    said = ended.stderr.splitlines()
    assert [line.split(": ", 1)[0] for line in said] == [
        f"{bad}:9:13",
        f"{bad}:11:19",
        f"{bad}:12:13",
        f"{tmp_path}/nowhere.yaml:1:1",
    ]
    assert "unknown signal 'w'" in said[0]
    assert "'/b' is no stream of this spec" in said[1]
    assert "action is `log`" in said[2]
    assert "can't be read: No such file or directory" in said[3]
    assert ended.stdout == f"{good}: sound\n"


def test_check_tells_warnings_of_a_sound_spec() -> None:
    lamp = Path(__file__).parent / "vectors" / "specs" / "lamp.yaml"
    ended = run("check", lamp)
    assert (ended.returncode, ended.stdout) == (0, f"{lamp}: sound\n")
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f"{lamp}:18:20: warning: ")


# replay


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
    keys = "n step property order outcome stream kind monitor seq stamp arrived judged late skewed degraded decision passed"
    for record in records:
        assert set(keys.split()) <= set(record)
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
    assert [r["step"] for r in alarms][0] == 5
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
    ("fault_wrong_status", "status_matches_percentage", 167, "/battery_status", "topic", {"id": "51"}),
    ("fault_status_without_cause", "status_matches_percentage", 168, "/battery_status", "topic", {"id": "0"}),
    ("fault_request_without_change", "request_has_a_cause", 168, "/SetLED", "request", {"req_id": "51"}),
    ("fault_silent_panel", "request_is_followed_by_response", 300, "/LED_panel", "topic", {"id": "71"}),
]


@pytest.mark.parametrize(("trace", "prop", "step", "stream", "kind", "signals"), FAULTS)
def test_each_fault_is_found_by_its_property_at_its_event(
    trace: str, prop: str, step: int, stream: str, kind: str, signals: dict[str, str]
) -> None:
    records, summary = replayed(TRACES / f"{trace}.jsonl", status=1)
    assert broken(summary) == {prop: 1}
    (violation,) = (r for r in records if r["violation"])
    assert (violation["property"], violation["step"]) == (prop, step)
    assert (violation["stream"], violation["kind"], violation["outcome"]) == (stream, kind, "currently_false")
    assert signals.items() <= violation["explanation"]["event"]["signals"].items()
    assert summary["properties"][prop]["first_violation"] == violation["n"]
    text = run("replay", SPEC, TRACES / f"{trace}.jsonl")
    assert text.returncode == 1
    head, *table = text.stdout.splitlines()
    assert head.startswith(f"violation {violation['n']}: {prop} does not hold at step {step}, {stream} ")
    assert f"{summary['events']} events, 1 violations, 0 late" in table
    assert [line for line in table if line.startswith(f"{prop} ")]


def test_replay_of_a_sound_trace_as_text() -> None:
    ended = run("replay", SPEC, TRACES / "in_order.jsonl")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "violation " not in ended.stdout
    assert all(name in ended.stdout for name in PROPERTIES)


def test_replay_of_an_empty_trace(tmp_path: Path) -> None:
    (tmp_path / "empty.jsonl").write_text("")
    records, summary = replayed(tmp_path / "empty.jsonl", status=0)
    assert (records, summary["events"]) == ([], 0)
    assert {p["first_violation"] for p in summary["properties"].values()} == {None}


def test_replay_into_a_pipe_that_closes_early() -> None:
    command = [COMMAND, "replay", SPEC, TRACES / "in_order.jsonl", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment()) as process:
        assert process.stdout
        assert process.stderr
        assert json.loads(process.stdout.readline())["n"] == 1
        process.stdout.close()
        said = process.stderr.read()
        process.wait(PATIENCE)
    assert said == b""


EXPECTED: dict[str, str] = json.loads((CORPUS / "traces" / "expected.json").read_text())


@pytest.mark.parametrize("name", EXPECTED)
def test_a_malformed_trace_is_refused_with_its_line(name: str) -> None:
    line = failed("replay", SPEC, CORPUS / "traces" / name)
    assert line.startswith(f"oracle-server: {CORPUS / 'traces' / name}{EXPECTED[name]}")


def test_the_corpus_of_traces_is_all_expected() -> None:
    assert {path.name for path in (CORPUS / "traces").glob("*.jsonl")} == set(EXPECTED)


def test_replay_of_what_can_not_be_used(tmp_path: Path) -> None:
    assert "nowhere.jsonl" in failed("replay", SPEC, "nowhere.jsonl")
    assert "nowhere.yaml:1:1" in failed("replay", "nowhere.yaml", TRACES / "in_order.jsonl")
    assert "trace.txt" in failed("replay", SPEC, "trace.txt")
    (tmp_path / "folder.jsonl").mkdir()
    assert "folder.jsonl" in failed("replay", SPEC, tmp_path / "folder.jsonl")
    assert "sideways" in failed("replay", SPEC, TRACES / "in_order.jsonl", "--by", "sideways")
    (tmp_path / "bad.yaml").write_text(SOUND + "colour: red\n")
    assert "bad.yaml:7:1: unknown key 'colour'" in failed("replay", tmp_path / "bad.yaml", TRACES / "in_order.jsonl")


# serve, where it refuses to start


def test_serve_refuses_a_port_that_is_taken(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        line = failed("serve", "--specs", ROOT / "specs", "--data-dir", tmp_path / "data", "--port", str(port))
    assert f"127.0.0.1:{port}" in line
    assert "--port" in line


def test_serve_refuses_an_unsound_spec(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text(SOUND + "colour: red\n")
    line = failed("serve", "--specs", tmp_path, "--data-dir", tmp_path / "data", "--port", "0")
    assert f"{tmp_path}/bad.yaml:7:1: unknown key 'colour'" in line


def test_serve_refuses_two_specs_of_one_id(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / f"{name}.yaml").write_text(SOUND)
    line = failed("serve", "--specs", tmp_path, "--data-dir", tmp_path / "data", "--port", "0")
    assert "one.yaml" in line
    assert "two.yaml" in line


def test_serve_refuses_a_data_folder_that_another_one_uses(tmp_path: Path) -> None:
    with Server(copy_specs(tmp_path / "specs"), tmp_path / "data"):
        line = failed("serve", "--specs", ROOT / "specs", "--data-dir", tmp_path / "data", "--port", "0")
    assert str(tmp_path / "data") in line


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "example.invalid", "192.0.2.1", ""])
def test_serve_refuses_to_be_reached_from_elsewhere(tmp_path: Path, host: str) -> None:
    line = failed("serve", "--specs", ROOT / "specs", "--data-dir", tmp_path, "--host", host, "--port", "0")
    assert host in line


def test_serve_refuses_folders_that_it_can_not_use(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for data in (tmp_path / "file", tmp_path / "file" / "data"):
        assert str(data) in failed("serve", "--specs", ROOT / "specs", "--data-dir", data, "--port", "0")
    for specs in (tmp_path / "file", tmp_path / "nowhere"):
        assert str(specs) in failed("serve", "--specs", specs, "--data-dir", tmp_path / "data", "--port", "0")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "history.sqlite").write_text("no database")
    line = failed("serve", "--specs", ROOT / "specs", "--data-dir", tmp_path / "broken", "--port", "0")
    assert "history.sqlite" in line


def test_serve_refuses_settings_that_make_no_sense(tmp_path: Path) -> None:
    assert "ORACLE_PORT" in failed("serve", "--data-dir", tmp_path, ORACLE_PORT="many")
    assert "ORACLE_RESUME_WITHIN" in failed("serve", "--data-dir", tmp_path, ORACLE_RESUME_WITHIN="-1")
    assert "--port" in failed("serve", "--data-dir", tmp_path, "--port", "65536")
    assert "--colour" in failed("serve", "--colour", "red")


# What reads a running server


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("cli")
    with Server(copy_specs(folder / "specs"), folder / "data") as running:
        yield running


async def test_reading_a_running_server(server: Server) -> None:
    async with attached(server, session="s1", spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"v": v}) for i, v in enumerate((1, 11, 1), start=1)))
        await monitor.acked(3)
        for command, document in (("specs", server.get("specs")), ("sessions", server.get("sessions"))):
            told = run(command, "--json", "--url", server.url)
            assert (told.returncode, told.stderr) == (0, "")
            assert [item["id"] for item in json.loads(told.stdout)["items"]] == [i["id"] for i in document["items"]]
            table = run(command, ORACLE_URL=server.url)
            assert (table.returncode, table.stderr) == (0, "")
            assert len(table.stdout.splitlines()) == 1 + len(document["items"])
        row = run("sessions", "--url", server.url).stdout.splitlines()[1].split()
        assert row == ["s1", "single", "open", "1", "3", "1"]

    records = server.records("s1")
    told = run("verdicts", "s1", "--json", "--url", server.url)
    assert (told.returncode, json.loads(told.stdout)["items"]) == (0, records)
    for options in (["--outcome", "currently_false"], ["--outcome", "currently_false", "--property", "a_is_small"]):
        told = run("verdicts", "s1", "--json", "--url", server.url, *options)
        assert json.loads(told.stdout)["items"] == [records[1]]
        table = run("verdicts", "s1", "--url", server.url, *options)
        head, row_text = table.stdout.splitlines()
        assert head.split()[:4] == ["n", "step", "property", "outcome"]
        assert row_text.split()[:5] == ["2", "2", "a_is_small", "currently_false", "/a"]
    assert json.loads(run("verdicts", "s1", "--json", "--url", server.url, "--property", "x").stdout)["items"] == []

    summary = run("verdicts", "s1", "--url", server.url)
    assert (summary.returncode, summary.stderr) == (0, "")
    lines = summary.stdout.splitlines()
    assert lines[1].split() == ["a_is_small", "currently_true", "1", "2", "0"]
    assert lines[-1].split()[:4] == ["2", "2", "a_is_small", "currently_false"]
    assert records[1]["stamp"] == BASE + 2 * 10**6


def test_reading_what_a_server_does_not_have(server: Server) -> None:
    assert "nowhere" in failed("verdicts", "nowhere", "--url", server.url)
    assert "nowhere" in failed("verdicts", "nowhere", "--json", "--url", server.url)
    assert "outcome" in failed("verdicts", "nowhere", "--outcome", "maybe", "--url", server.url)


@pytest.mark.parametrize("command", [["specs"], ["sessions"], ["verdicts", "s1"], ["sessions", "--json"]])
def test_reading_a_server_that_is_not_there(command: list[str]) -> None:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{nobody.getsockname()[1]}"
        line = failed(*command, "--url", url)
    assert url in line
    assert "oracle-server serve" in line
    assert "no_url" in failed(*command, "--url", "no_url")


def test_commands_that_are_none() -> None:
    assert "nonsense" in failed("nonsense")
    assert "SPEC" in failed("check")
