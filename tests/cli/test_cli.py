"""The command line, run as its users run it."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from oracle_server.core.naming import moment
from tests.whole.client import BASE, attached, make_event
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server, failed, run

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "specs" / "battery_uav.yaml"

SOUND = """\
id: sound
streams:
  - topic: /a
    signals: {v: msg.v}
properties:
  - id: p
    formula: 'not {topic: "/a", v: 7}'
"""
TYPES = ROOT / "examples" / "battery_uav" / "ros2" / "battery_uav_msgs"


# check


def test_check_of_sound_specs() -> None:
    ended = run("check", *sorted((ROOT / "specs").glob("*.yaml")), "--types", TYPES)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert f"{SPEC}: sound" in ended.stdout


def test_check_prints_formulas_with_names_written_out(tmp_path: Path) -> None:
    spec = tmp_path / "s.yaml"
    spec.write_text(
        "id: s\ndefine: {near(r): '{robot: *r, d < limit}'}\nstreams:\n  - topic: /a\n"
        "    signals: {robot: msg.r, d: msg.d, limit: msg.l}\n"
        "properties:\n  - {id: p, time: seconds, formula: 'forall[x]. near(x) -> not lasting[2s] near(x)'}\n"
    )
    told = "forall[x]. {robot: *x, d < limit} -> not lasting[2s] {robot: *x, d < limit}"
    assert run("check", spec, "--formulas").stdout == f"{spec}: p: {told}\n{spec}: sound\n"
    (line,) = run("check", spec, "--formulas", "--json").stdout.splitlines()
    assert json.loads(line) == {"file": str(spec), "property": "p", "time": "seconds", "formula": told}


def test_check_tells_how_types_are_made_known(tmp_path: Path) -> None:
    ended = run("check", SPEC)
    assert (ended.returncode, ended.stdout) == (0, f"{SPEC}: sound\n1 spec sound, 1 warning\n")
    (line,) = ended.stderr.splitlines()
    assert "warning: the package battery_uav_msgs is not known here" in line
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(SPEC.read_text().replace("msg.percentage", "msg.percentag"))
    refused = run("check", wrong, "--types", TYPES)
    assert refused.returncode == 1
    assert "battery_uav_msgs/msg/BatteryPercentage has no field `percentag`" in refused.stderr
    assert "no folder" in failed("check", SPEC, "--types", tmp_path / "nowhere")


def test_check_for_ros_2_warns_of_a_denied_call_that_could_look_like_a_success(tmp_path: Path) -> None:
    spec = tmp_path / "spec.yaml"
    spec.write_text(
        "id: doors\n"
        "streams:\n"
        "  - {service: /open, action: filter}\n"
        "  - {service: /close, action: filter, denied_response: {success: false}}\n"
        "  - {service: /state, request: {signals: {v: msg.v}}}\n"
        "properties:\n"
        "  - id: p\n"
        "    formula: 'not {kind: request, v: 7}'\n"
        "    guards: [/open, /close]\n"
    )
    plain, first, second = run("check", spec), run("check", "--ros", "1", spec), run("check", "--ros", "2", spec)
    assert {ended.returncode for ended in (plain, first, second)} == {0}
    assert (plain.stderr, "denied_response" in first.stderr) == ("", False)
    (line,) = second.stderr.splitlines()
    assert line.startswith(f"{spec}:3:30: warning: /open is filtered without a `denied_response`: on ROS 2")


def test_check_for_ros_2_warns_of_names_that_it_refuses(tmp_path: Path) -> None:
    spec = tmp_path / "spec.yaml"
    spec.write_text(
        "id: named\n"
        "streams:\n"
        "  - {topic: /1/cmd, type: std_msgs/Header}\n"
        "  - {service: /a__b, type: std_srvs/srv/SetBool}\n"
        "  - {service: /_a_1/b2_, type: std_srvs/srv/SetBool}\n"
        "properties: [{id: p, formula: 'not {data}'}]\n"
    )
    assert run("check", "--ros", "1", spec).stderr == ""
    digit, underscores = run("check", "--ros", "2", spec).stderr.splitlines()
    assert digit.startswith(f"{spec}:3:13: warning: stream '/1/cmd': ROS 2 has no name in which a part begins with a")
    assert underscores.startswith(f"{spec}:4:15: warning: stream '/a__b': ROS 2 has no name with `__`")


def test_check_foresees_a_deadlock_by_the_robot_s_graph(tmp_path: Path) -> None:
    waits, graph = tmp_path / "waits.yaml", tmp_path / "graph.json"
    text = SPEC.read_text()
    assert text.count("max_delay: 200ms") == text.count("    causes: [/status_accepted]") == 1
    waits.write_text(text.replace("max_delay: 200ms", "max_delay: none").replace("    causes: [/status_accepted]", ""))
    supervisor = {"name": "/supervisor", "publishes": {"/battery_status": []}, "calls": {"/SetLED_mon": ["x/srv/Y"]}}
    graph.write_text(json.dumps({"nodes": [supervisor]}))
    assert run("check", waits).returncode == 0
    ended = run("check", waits, "--ros-graph", graph)
    assert ended.returncode == 1
    (line,) = (line for line in ended.stderr.splitlines() if "warning" not in line)
    assert "deadlock: /SetLED -> /battery_status -> /SetLED" in line
    assert "by /supervisor" in line
    assert run("check", SPEC, "--ros-graph", graph).returncode == 0
    for broken in ('{"nodes": 7}', "{", ""):
        graph.write_text(broken)
        assert "--dump-graph" in failed("check", SPEC, "--ros-graph", graph)
    assert "--dump-graph" in failed("check", SPEC, "--ros-graph", tmp_path / "nowhere.json")


def test_check_for_ros_1_warns_of_topics_that_are_ordered_by_their_arrival(tmp_path: Path) -> None:
    spec = tmp_path / "spec.yaml"
    spec.write_text(
        "id: mixed\n"
        "streams:\n"
        "  - {topic: /number, type: std_msgs/Int64}\n"
        "  - {topic: /loose, type: std_msgs/Int64, ordered: false}\n"
        "  - {topic: /placed, type: std_msgs/Time, stamp: data}\n"
        "  - {topic: /point, type: geometry_msgs/msg/PointStamped}\n"
        "  - {topic: /own, type: std_msgs/Header}\n"
        "  - {service: /open, type: std_srvs/SetBool}\n"
        "properties: [{id: p, formula: 'not {data: 7}'}]\n"
    )
    plain, first, second = run("check", spec), run("check", "--ros", "1", spec), run("check", "--ros", "2", spec)
    assert {ended.returncode for ended in (plain, first, second)} == {0}
    assert plain.stderr == second.stderr == ""
    (line,) = first.stderr.splitlines()
    assert line.startswith(f"{spec}:3:13: warning: /number is ordered by its arrival on ROS 1")
    by_arrival = tmp_path / "by_arrival.yaml"
    by_arrival.write_text(spec.read_text() + "ordering: {by: arrival}\n")
    assert run("check", "--ros", "1", by_arrival).stderr == ""


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
    assert ended.stdout == f"{good}: sound\n1 spec sound, 4 errors\n"


def test_check_tells_warnings_of_a_sound_spec() -> None:
    lamp = Path(__file__).parents[1] / "vectors" / "specs" / "lamp.yaml"
    ended = run("check", lamp)
    assert (ended.returncode, ended.stdout) == (0, f"{lamp}: sound\n1 spec sound, 2 warnings\n")
    types, line = ended.stderr.splitlines()
    assert types.startswith(f"{lamp}:8:11: warning: the package example_msgs is not known here")
    assert line.startswith(f"{lamp}:18:20: warning: ")


def test_check_refuses_warnings_where_it_is_strict(tmp_path: Path) -> None:
    lamp = Path(__file__).parents[1] / "vectors" / "specs" / "lamp.yaml"
    ended = run("check", "--strict", lamp, SPEC, "--types", TYPES)
    assert (ended.returncode, ended.stdout) == (1, f"{SPEC}: sound\n1 spec sound, 2 warnings\n")
    assert f"{lamp}:18:20: warning: " in ended.stderr
    assert ended.stderr.splitlines()[-1] == f"{lamp}: refused because of --strict: 2 warnings"
    assert run("check", "--strict", SPEC, "--types", TYPES).returncode == 0


def test_check_prints_what_it_finds_as_json(tmp_path: Path) -> None:
    lamp, bad = Path(__file__).parents[1] / "vectors" / "specs" / "lamp.yaml", tmp_path / "bad.yaml"
    bad.write_text(SOUND + "colour: red\n")
    ended = run("check", "--json", lamp, bad)
    assert (ended.returncode, ended.stderr) == (1, "")
    _, warning, error = (json.loads(line) for line in ended.stdout.splitlines())
    assert (warning["file"], warning["line"], warning["column"], warning["severity"]) == (str(lamp), 18, 20, "warning")
    assert (error["file"], error["line"], error["column"], error["severity"]) == (str(bad), 8, 1, "error")
    assert "colour" in error["message"]
    assert (warning["kind"], error["kind"]) == ("general", "general")


KINDS = {
    "vacuous": SOUND.replace('not {topic: "/a", v: 7}', "{kind: topic} or {v: 7}"),
    "unjudged": SOUND.replace("msg.v", "todo()"),
    "type": SOUND.replace("topic: /a", "topic: /a\n    type: unknown_msgs/msg/Unknown"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_check_says_of_what_kind_a_finding_is(kind: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(KINDS[kind])
    ended = run("check", "--json", tmp_path / "a.yaml")
    assert [json.loads(line)["kind"] for line in ended.stdout.splitlines()] == [kind]


def test_check_counts_errors_and_warnings(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(KINDS["vacuous"])
    (tmp_path / "b.yaml").write_text(KINDS["type"].replace("unknown_msgs", "std_msgs").replace("id: p", "id: q"))
    ended = run("check", "--ros", "1", tmp_path / "a.yaml", tmp_path / "b.yaml")
    assert ended.stdout.splitlines()[-1] == "1 spec sound, 1 error, 1 warning"
    assert "which carries no publication time" not in ended.stderr, "nothing is known of a type that is not there"


def test_check_warns_of_two_specs_with_one_id(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / f"{name}.yaml").write_text(SOUND)
    ended = run("check", tmp_path / "one.yaml", tmp_path / "two.yaml")
    assert ended.returncode == 0
    assert f"two.yaml:1:1: warning: the id 'sound' is that of {tmp_path}/one.yaml already" in ended.stderr


# serve, where it refuses to start


def test_serve_refuses_a_port_that_is_taken(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        line = failed("serve", "--specs", ROOT / "specs", "--data-dir", tmp_path / "data", "--port", str(port))
    assert f"127.0.0.1:{port}" in line
    assert "--port" in line


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


AT_2 = moment(BASE + 2 * 10**6, time.time_ns())
"""When step 2 was published, as told today."""


async def test_reading_a_running_server(server: Server) -> None:
    async with attached(server, session="s1", spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"v": v}) for i, v in enumerate((1, 11, 1), start=1)))
        await monitor.acked(3)
        listed = await asyncio.to_thread(run, "sessions", "--url", server.url)
        row = listed.stdout.splitlines()[1].split()
        assert row == ["s1", "single", "live", "1", "3", "1", "step", "2,", *AT_2.split()]

    for command, document in (("specs", server.get("specs")), ("sessions", server.get("sessions"))):
        told = run(command, "--json", "--url", server.url)
        assert (told.returncode, told.stderr) == (0, "")
        assert [item["id"] for item in json.loads(told.stdout)["items"]] == [i["id"] for i in document["items"]]
        table = run(command, ORACLE_URL=server.url)
        assert (table.returncode, table.stderr) == (0, "")
        assert len(table.stdout.splitlines()) == 1 + len(document["items"])
    records = server.records("s1")
    told = run("verdicts", "s1", "--json", "--url", server.url)
    assert (told.returncode, json.loads(told.stdout)["items"]) == (0, records)
    for options in (["--outcome", "currently_false"], ["--outcome", "currently_false", "--property", "a_is_small"]):
        told = run("verdicts", "s1", "--json", "--url", server.url, *options)
        assert json.loads(told.stdout)["items"] == [records[1]]
        table = run("verdicts", "s1", "--url", server.url, *options)
        head, row_text = table.stdout.splitlines()
        assert head.split() == ["step", "time", "property", "outcome", "stream", "kind", "decision", "n"]
        assert row_text.split() == ["2", *AT_2.split(), "a_is_small", "currently_false", "/a", "topic", "-", "2"]
    for asked in (("verdicts",), ("verdicts", "--json"), ("verdicts", "--follow"), ("episodes",)):
        assert failed(*asked, "s1", "--url", server.url, "--property", "a_is_smal").endswith(
            ": query.property: single has no property `a_is_smal`; did you mean `a_is_small`?"
        )

    summary = run("verdicts", "s1", "--url", server.url)
    assert (summary.returncode, summary.stderr) == (0, "")
    lines = summary.stdout.splitlines()
    assert lines[1].split() == ["a_is_small", "currently_true", "1", "step", "2,", *AT_2.split(), "0"]
    assert lines[-3].split()[-6:] == ["a_is_small", "currently_false", "/a", "topic", "-", "2"]
    assert lines[-1].startswith(f"a_is_small does not hold at step 2 ({moment(BASE + 2 * 10**6)}), /a ")
    assert "v = 11" in lines[-1]
    assert lines[-1].endswith(" (#2)")
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
    assert "oracle-server start" in line
    assert "no_url" in failed(*command, "--url", "no_url")


def test_a_command_loads_only_what_it_needs() -> None:
    """Help, and a word that is mistyped, wait for no engine and no server."""
    program = "import sys, oracle_server.cli.commands; print(*sys.modules)"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, encoding="utf-8", check=True)
    loaded = set(ended.stdout.split())
    assert "oracle_server.cli.commands" in loaded
    assert not loaded & {"fastapi", "httpx", "lark", "msgspec", "pydantic", "re2", "rich.console", "uvicorn", "yaml"}


@pytest.mark.parametrize(("group", "commands"), [("token", ("add", "remove", "list")), ("history", ("copy",))])
def test_a_group_alone_says_which_commands_it_has(group: str, commands: tuple[str, ...]) -> None:
    ended = run(group)
    assert (ended.returncode, ended.stderr) == (0, "")
    told = [line.split()[0] for line in ended.stdout.partition("Commands:")[2].splitlines() if line]
    assert told == list(commands)


def test_commands_that_are_none() -> None:
    assert "nonsense" in failed("nonsense")
    assert "SPEC" in failed("check")


def test_a_choice_that_is_none_is_told_in_one_line() -> None:
    """The library's own text has tabs, and words of another library."""
    assert failed("token", "add", "uav1").endswith("Missing option '--scope'. Choose from: submit, read, admin")
    assert "for '--format': 'xml' is not one of 'text', " in failed("check", "--format", "xml", SPEC)


@pytest.mark.parametrize("command", [("serve",), ("status",), ("token", "list")])
def test_a_data_directory_without_a_name_is_refused(command: tuple[str, ...]) -> None:
    """As of `--data-dir "$DATA"` where that is not set: it was the folder in which the command was run."""
    assert "'--data-dir': it is empty: leave it out, or name a file or a folder" in failed(*command, "--data-dir", "")


def test_no_other_path_without_a_name_is_the_working_directory() -> None:
    assert "'FOLDER': it is empty" in failed("init", "")
    for option in ("--specs", "--types", "--unix", "--tls-cert", "--tls-key", "--tls-client-ca"):
        assert f"'{option}': it is empty" in failed("serve", option, "")
