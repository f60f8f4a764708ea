"""`import`: configurations of every dialect and property modules that are read and never run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.spec import External
from oracle_server.core.stamps import Stamp
from oracle_server.specfiles.load import parse_spec
from tests.whole.harness import failed, run

FIRST = """
path: /home/user/catkin_ws/src
nodes:
  - node: {name: talker, package: chat, path: /home/user/launch.py}
monitors:
  - monitor:
      id: monitor_0
      log: ./log.txt
      silent: False
      oracle: {port: 8080, url: 127.0.0.1, action: nothing}
      topics:
        - {name: chatter, type: std_msgs.msg.String, action: filter, warning: 1, publishers: [talker]}
        - {name: count, type: std_msgs.msg.Int32, action: log}
"""
SECOND = """
monitors:
  - monitor:
      id: uav
      oracle: {port: 8081, url: 10.0.0.1, action: nothing, timeout: 3}
      topics:
        - {name: /battery, type: std_msgs/Float32, action: log}
        - {name: /status, type: std_msgs/String, action: filter, subscribers: [led]}
      services:
        - {name: /SetLED, type: uav_msgs.srv.SetLED, action: filter}
      ordered_topics: [/battery]
      ordered_services: [{name: SetLED}]
"""
REWRITE = """
ros_version: ros2
monitors:
  - monitor:
      id: rewrite
      oracle: {port: 8080, url: 127.0.0.1, action: nothing}
      status: {enabled: true}
      colour: red
      topics:
        - {name: pose, type: geometry_msgs/msg/PoseStamped, ordered: true,
           ordering: {enabled: true, order_by: header.stamp, max_delay_ms: 50}}
        - {name: scan, type: sensor_msgs/msg/LaserScan, ordered: true}
"""
MODULE = """
import oracle
import os
open("RAN", "w")

PROPERTY = r"historically{hello: True} and once[:10]{small: True} and {odd < 1}"

predicates = dict(time = 0, hello = True, small = False, odd = 0)

def abstract_message(message):
    if message['topic'] == 'chatter' and "hello" in message['data']:
        predicates['hello'] = True
    else:
        predicates['hello'] = False
    if message['topic'] == '/count':
        predicates['small'] = message['data'] < 10 or message['data'] in [77, 78]
        predicates['odd'] = hash(message['data']) % 2
    predicates['time'] = message['time']
    return predicates
"""


def imported(folder: Path, config: str, ends: int = 0, **modules: str) -> tuple[str, Any]:
    path = folder / "config.yaml"
    path.write_text(config)
    options: list[str | Path] = []
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)
        options += ["--properties", folder / f"{name}.py"]
    out = folder / "spec.yaml"
    ended = run("import", path, *options, "-o", out)
    assert ended.returncode == ends, ended.stderr
    text = out.read_text()
    return text, parse_spec(text, "imported").spec


def test_version_one_is_judged_by_arrival(tmp_path: Path) -> None:
    text, spec = imported(tmp_path, FIRST)
    assert (spec.id, spec.ordering.by) == ("monitor_0", "arrival")
    chatter, count = spec.streams
    assert (chatter.name, chatter.type, chatter.action, chatter.intercept) == (
        "/chatter", "std_msgs/msg/String", "filter", "publisher",
    )  # fmt: skip
    assert (count.name, count.action) == ("/count", "log")
    assert spec.properties[0].guards == {"/chatter"}
    for word in ("`path`", "`nodes`", "`log` of monitor", "`silent` of monitor", "`warning`", "ws://127.0.0.1:8080"):
        assert word in text


def test_version_two_orders_what_it_ordered(tmp_path: Path) -> None:
    _, spec = imported(tmp_path, SECOND)
    by_name = {(s.name, s.kind): s for s in spec.streams}
    assert spec.ordering.by == "publication"
    assert {key for key, s in by_name.items() if s.ordered} == {
        ("/battery", "topic"), ("/SetLED", "request"), ("/SetLED", "response"),
    }  # fmt: skip
    assert by_name["/status", "topic"].intercept == "subscriber"
    assert by_name["/SetLED", "request"].decide_within == 3_300 * 10**6
    assert by_name["/SetLED", "request"].proxy == "/SetLED_mon"


def test_without_a_module_the_oracle_stays_who_judges(tmp_path: Path) -> None:
    text, spec = imported(tmp_path, SECOND)
    (prop,) = spec.properties
    assert prop.external == External("ws://10.0.0.1:8081", 3 * 10**9)
    assert prop.guards == {"/status", "/SetLED"}
    assert {s.decide_within for s in spec.streams if s.action == "filter"} == {3_300 * 10**6}
    assert "TODO" not in text.partition("properties:")[2]
    _, spec = imported(tmp_path, FIRST)
    assert spec.properties[0].external == External("ws://127.0.0.1:8080", 2 * 10**9, bare=True)


def test_the_rewrite_keeps_its_delays_and_stamps(tmp_path: Path) -> None:
    text, spec = imported(tmp_path, REWRITE)
    pose, scan = spec.streams
    assert spec.ordering.max_delay == 50 * 10**6
    assert (pose.stamp, pose.ordered, scan.ordered) == (Stamp("header.stamp"), True, False)
    assert "`ordered: true` alone put nothing in order there" in text
    assert "`colour` of monitor" in text


def test_a_property_module_is_read_and_never_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text, spec = imported(tmp_path, FIRST, hello=MODULE)
    assert not (tmp_path / "RAN").exists()
    chatter, count = spec.streams
    assert chatter.signals == {"hello": "msg.data.contains('hello')", "odd": "todo()"}
    assert count.signals == {"hello": "false", "small": "msg.data < 10 || msg.data in [77, 78]", "odd": "todo()"}
    assert count.hold == {"small"}
    assert "# predicates['odd'] = hash(message['data']) % 2" in text
    (prop,) = spec.properties
    assert (prop.id, prop.text) == ("hello", "historically {hello} and once[:10] {small} and {odd < 1}")
    assert "Bounds count events here" in text


def test_bounds_that_count_events_are_told(tmp_path: Path) -> None:
    plain = MODULE.replace(" and once[:10]{small: True} and {odd < 1}", "")
    bounded = MODULE.replace(" and {odd < 1}", "")
    (tmp_path / "config.yaml").write_text(FIRST)
    for module, told in ((plain, False), (bounded, True)):
        (tmp_path / "hello.py").write_text(module)
        ended = run(
            "import", tmp_path / "config.yaml", "--properties", tmp_path / "hello.py", "-o", tmp_path / "s.yaml"
        )
        note = "the bounds of hello count events, as with an oracle's --discrete; where it ran with --dense they were"
        assert (note in ended.stdout + ended.stderr) is told
        assert ended.returncode == 0


def test_what_is_left_to_write_is_counted_and_strict_refuses_it(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(FIRST)
    (tmp_path / "hello.py").write_text(MODULE)
    files = (tmp_path / "config.yaml", "--properties", tmp_path / "hello.py", "-o", tmp_path / "spec.yaml")
    ended = run("import", *files)
    assert ended.returncode == 0
    assert "is not done: odd: unknown until written, at the lines marked TODO" in ended.stderr
    assert run("import", *files, "--strict").returncode == 1
    told = "spec.yaml:20:14: warning: 'odd' is still to be written: `todo()` has no value, here and at /count, so that"
    for said in (ended, run("check", tmp_path / "spec.yaml")):
        assert told in said.stderr
        assert said.stderr.count("still to be written") == 1


def test_an_import_that_judges_nothing_says_so_and_ends_with_1(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(FIRST)
    function = "\ndef abstract_message(message):\n    return {'p': hash(message['data'])}\n"
    (tmp_path / "one.py").write_text(f"PROPERTY = '{{p}}'{function}")
    (tmp_path / "other.py").write_text(f"PROPERTY = '{{p}} -> {{q}} -> {{p}}'{function}")
    modules = ("--properties", tmp_path / "one.py", "--properties", tmp_path / "other.py")
    ended = run("import", tmp_path / "config.yaml", *modules, "-o", tmp_path / "spec.yaml")
    assert ended.returncode == 1
    assert "nothing was imported that judges anything" in ended.stderr.splitlines()[-1]
    (tmp_path / "sound.py").write_text("PROPERTY = '{p}'\ndef abstract_message(message):\n    return {'p': True}\n")
    ended = run("import", tmp_path / "config.yaml", *modules, "--properties", tmp_path / "sound.py")
    assert ended.returncode == 0
    assert "nothing was imported" not in ended.stderr


def test_a_property_module_in_the_place_of_the_configuration_is_named(tmp_path: Path) -> None:
    (tmp_path / "hello.py").write_text(MODULE)
    told = failed("import", tmp_path / "hello.py")
    assert "Python" in told
    assert "--properties hello.py" in told


def test_what_is_done_is_sound_and_strict_accepts_it(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(FIRST)
    module = MODULE.replace("historically{hello: True}", "once{hello: True}")
    (tmp_path / "hello.py").write_text(module.replace("hash(message['data']) % 2", "len(str(message['data'])) % 2"))
    files = (tmp_path / "config.yaml", "--properties", tmp_path / "hello.py", "-o", tmp_path / "spec.yaml")
    ended = run("import", *files, "--strict")
    assert (ended.returncode, ended.stderr.splitlines()[0]) == (0, f"{tmp_path / 'spec.yaml'}: sound")
    assert run("check", "--strict", tmp_path / "spec.yaml").returncode == 0


def test_what_check_refuses_is_told_and_ends_with_1(tmp_path: Path) -> None:
    """The type is misspelt: the module is read as of messages of any type, and written all the same."""
    (tmp_path / "config.yaml").write_text(FIRST.replace("msg.Int32", "msg.Int23"))
    (tmp_path / "hello.py").write_text(MODULE)
    out = tmp_path / "spec.yaml"
    ended = run("import", tmp_path / "config.yaml", "--properties", tmp_path / "hello.py", "-o", out)
    assert ended.returncode == 1
    assert "the package std_msgs has no msg 'Int23'; did you mean" in ended.stderr
    assert f"{out}: is refused by `check`: mend 1 place named above" in ended.stderr
    assert "is not done: odd" in ended.stderr
    assert out.exists()


def test_a_module_that_fails_at_a_stream_is_told_of(tmp_path: Path) -> None:
    module = "PROPERTY = 'once{far}'\npredicates = dict(far=False)\n" + (
        "def abstract_message(m):\n    predicates['far'] = m['range'] > 2\n    return predicates\n"
    )
    (tmp_path / "config.yaml").write_text(
        "monitors: [{monitor: {id: m, topics: [{name: sonar, type: sensor_msgs.msg.Range, action: log},"
        " {name: chatter, type: std_msgs.msg.String, action: log}]}}]"
    )
    (tmp_path / "far.py").write_text(module)
    files = (tmp_path / "config.yaml", "--properties", tmp_path / "far.py", "-o", tmp_path / "spec.yaml")
    assert "is unknown where a module fails, whatever the message has: chatter topic" in run("import", *files).stderr
    assert run("import", *files, "--strict").returncode == 1


def test_types_of_a_folder_are_known(tmp_path: Path) -> None:
    (tmp_path / "my_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "my_msgs" / "package.xml").write_text("<package><name>my_msgs</name></package>")
    (tmp_path / "my_msgs" / "msg" / "Gate.msg").write_text("bool open\nfloat32[] gaps\n")
    (tmp_path / "config.yaml").write_text(
        "monitors: [{monitor: {id: m, topics: [{name: gate, type: my_msgs.msg.Gate, action: log}]}}]"
    )
    (tmp_path / "gate.py").write_text(
        "PROPERTY = 'once{open} and {gaps}'\npredicates = dict(open=False, gaps=True)\n"
        "def abstract_message(m):\n    predicates['open'] = m['open'] == 1\n"
        "    predicates['gaps'] = True if m['gaps'] else False\n    return predicates\n"
    )
    files = (tmp_path / "config.yaml", "--properties", tmp_path / "gate.py", "-o", tmp_path / "spec.yaml")
    assert run("import", *files, "--types", tmp_path / "my_msgs", "--strict").returncode == 0
    signals = parse_spec((tmp_path / "spec.yaml").read_text(), "s").spec.streams[0].signals
    assert signals == {"gaps": "size(msg.gaps) > 0", "open": "msg.open"}
    assert run("import", *files).returncode == 0
    checked = run("check", tmp_path / "spec.yaml", "--types", tmp_path / "my_msgs")
    assert checked.returncode == 0, "what is written of an unknown type suits any"
    assert "the item `0` of the list never matches" in checked.stderr


def test_modules_that_share_a_name_keep_their_own_predicates(tmp_path: Path) -> None:
    far = "PROPERTY = '{far}'\npredicates = dict(far=False)\n" + (
        "def abstract_message(m):\n    predicates['far'] = m['data'] > LIMIT\n    return predicates\n"
    )
    _, spec = imported(tmp_path, FIRST, one=f"LIMIT = 1\n{far}", other=f"LIMIT = 2\n{far}")
    assert [p.text for p in spec.properties] == ["{far}", "{far_}"]
    assert spec.streams[1].signals == {"far": "msg.data > 1", "far_": "msg.data > 2"}
    assert spec.streams[0].signals == {"far": "unknown()", "far_": "unknown()"}, "a text is not compared with a number"


def test_a_formula_about_what_comes_stays_with_its_oracle(tmp_path: Path) -> None:
    module = "PROPERTY = 'F hello'\npredicates = dict(hello=False)\ndef abstract_message(m):\n    return predicates\n"
    text, spec = imported(tmp_path, FIRST, ltl=module)
    assert (spec.properties[0].id, spec.properties[0].external) == (
        "ltl",
        External("ws://127.0.0.1:8080", 2 * 10**9, bare=True),
    )
    assert "about what comes, so that its oracle still judges" in text


def test_a_specification_of_another_oracle_is_named(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(FIRST)
    (tmp_path / "chat.rml").write_text("Main = hello;")
    said = failed("import", tmp_path / "config.yaml", "--properties", tmp_path / "chat.rml")
    assert "an RML specification" in said
    assert "engine: external" in said


EVENTS: list[tuple[dict[str, Any], str]] = [
    ({"topic": "chatter", "data": "oh hello"}, "currently_false"),
    ({"topic": "count", "data": 5}, "currently_true"),
    ({"topic": "chatter", "data": "hello"}, "currently_true"),
    ({"topic": "chatter", "data": "bye"}, "currently_false"),
]


def test_an_imported_property_judges_as_its_module_did(tmp_path: Path) -> None:
    module = MODULE.replace(
        "        predicates['hello'] = False\n",
        "        predicates['hello'] = message['topic'] == 'count' and message['data'] == 5\n",
    )
    module = module.replace("hash(message['data']) % 2", "message['data'] % 2 - 1")
    imported(tmp_path, FIRST, hello=module)
    log = tmp_path / "log.jsonl"
    log.write_text("".join(json.dumps(e | {"time": i + 1.5, "verdict": v}) + "\n" for i, (e, v) in enumerate(EVENTS)))
    ended = run("replay", tmp_path / "spec.yaml", log, "--json")
    summary = json.loads(ended.stdout.splitlines()[-1])["summary"]
    assert (summary["events"], summary["compared"], summary["differing"]) == (4, 4, 0)


def test_stubs_make_what_reads_them_unknown(tmp_path: Path) -> None:
    module = "PROPERTY = '{far: True}'\npredicates = {'far': False}\n" + (
        "def abstract_message(m):\n    predicates['far'] = hash(m['data']) > 3\n    return predicates\n"
    )
    text, _ = imported(tmp_path, FIRST, ends=1, far=module)
    assert "# predicates['far'] = hash(m['data']) > 3" in text
    (tmp_path / "log.jsonl").write_text('{"topic": "count", "time": 1.5, "data": 5}\n')
    ended = run("replay", tmp_path / "spec.yaml", tmp_path / "log.jsonl", "--json")
    assert json.loads(ended.stdout.splitlines()[0])["outcome"] == "unknown"


@pytest.mark.parametrize(
    ("module", "word"),
    [
        ("x = 1", "no `PROPERTY"),
        ("PROPERTY = '{p}'", "no function `abstract_message"),
        ("PROPERTY = open('x').read()\ndef abstract_message(m): pass", "not made of constants"),
        ("PROPERTY = '{p}'\ndef abstract_message(m, limit): pass", "the message alone: give a default to `limit`"),
        ("def f(:", "module.py:1: not Python"),
        (None, "can't be read"),
    ],
)
def test_what_is_no_property_module_is_refused_in_one_line(tmp_path: Path, module: str | None, word: str) -> None:
    (tmp_path / "config.yaml").write_text(FIRST)
    if module is not None:
        (tmp_path / "module.py").write_text(module)
    assert word in failed("import", tmp_path / "config.yaml", "--properties", tmp_path / "module.py")
