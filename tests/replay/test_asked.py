"""Properties of which nothing was asked: what never held is said, and texts that no message of this robot has."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from oracle_server.replay.command import run_replay
from tests.replay.judging import judge, write_spec

SPEC = """\
id: a
ordering: {by: arrival}
streams:
  - {topic: /mode, signals: {mode: msg.data}}
  - {topic: /hit, signals: {hit: msg.hit}, hold: [hit]}
  - {topic: /cmd, signals: {speed: msg.x, user: msg.user, word: "msg.x > 1 ? 'fast' : 'slow'"}}
  - {topic: /joints, each: msg.name, signals: {joint: item, row: index, q: 'msg.position[index]'}}
  - {topic: /rows, each: msg.rows, signals: {part: item.part, state: item.state}}
properties:
"""
MODES: list[dict[str, Any]] = [{"topic": "/mode", "data": "AUTO"}, {"topic": "/mode", "data": "IDLE"}]
OTHERS: list[dict[str, Any]] = [
    {"topic": "/hit", "hit": False},
    {"topic": "/cmd", "x": 0.5, "user": "ann"},
    {"topic": "/cmd", "x": 0.2, "user": "bob"},
    {"topic": "/joints", "name": ["joint_0", "joint_1"], "position": [0.1, 0.2]},
    {"topic": "/joints", "name": ["joint_0", "joint_1"], "position": [0.1, 0.2]},
    {"topic": "/rows", "rows": [{"part": "arm", "state": "ok"}, {"part": "leg", "state": "ok"}]},
]
JOINTS = 'it was "joint_0" and "joint_1"'


def trace(folder: Path, *lines: dict[str, Any]) -> Path:
    path = folder / "trace.jsonl"
    path.write_text("".join(json.dumps({"time": n, **line}) + "\n" for n, line in enumerate(lines, 1)))
    return path


def spec_of(folder: Path, *properties: str) -> Path:
    return write_spec(folder, SPEC + "".join(f"  - {each}\n" for each in properties))


@pytest.mark.parametrize(
    ("formula", "never"),
    [
        ("{hit} -> {speed: 0}", "{hit}"),
        ("not {hit} or {speed: 0}", "{hit}"),
        ("{topic: /cmd} and {hit} -> {speed: 0}", "{hit}"),
        ("{topic: /cmd} -> ({hit} -> {speed: 0})", "{hit}"),
        ("{speed > 0} -> once {hit} -> {user: ann}", "{hit}"),
        ("historically ({hit} -> {speed: 0})", "{hit}"),
        ("{hit} -> eventually[:5] {speed: 0}", "{hit}"),
        ("forall[u]. {user: *u, speed > 3} -> not once {mode: *u}", "{user: *u, speed > 3}"),
        ("exists[u]. {user: *u, speed > 3} -> {hit}", None),
        ("{topic: /cmd} and {speed: 0.5} and {user: bob} -> {hit}", "{topic"),
        ("not ({topic: /cmd} and not {topic: /mode} since {hit})", "{hit}"),
        ("not ({hit} and {speed > 0})", None),
        ("not {hit}", None),
        ("{topic: /cmd} -> once {topic: /mode}", None),
        ("{hit} or {speed < 1} or not {topic: /cmd}", None),
        ("{topic: /cmd} -> {speed < 1}", None),
        ("not {hit} -> {speed < 1} or not {topic: /cmd}", None),
        ("({hit} -> {speed: 0}) and ({topic: /cmd} -> {speed < 1})", None),
        ("({hit} -> {speed: 0}) and {kind: *}", None),
    ],
)
def test_what_never_held_is_said_and_no_doubt(formula: str, never: str | None, tmp_path: Path) -> None:
    spec = spec_of(tmp_path, f"{{id: p, formula: '{formula}'}}")
    found = judge(spec, trace(tmp_path, *MODES, *OTHERS))
    said = [text for text in found.summary["notes"] if text.startswith("nothing was asked")]
    if never is None:
        assert not said
    else:
        assert len(said) == 1
        assert said[0].startswith(f"nothing was asked of p (`{never}")
        assert found.summary["doubts"] == []
        assert (found.exit, found.strict) == (0, 0)


@pytest.mark.parametrize(
    ("formula", "doubt"),
    [
        ("{joint: hip_roll} -> {q < 1}", f'p compares joint of /joints with "hip_roll", which it never was: {JOINTS}'),
        ("{joint: joint_0, q > 5} -> {q < 1}", ""),
        ("not {joint: hip_roll, q > 1}", f'joint of /joints with "hip_roll", which it never was: {JOINTS}'),
        ("not {joint: hip_roll}", ""),
        ("{mode: FAULT} -> {speed: 0}", 'mode of /mode with "FAULT", which it never was: it was "AUTO" and "IDLE"'),
        ("{mode: AUTO} or {mode: FAULT} -> not {speed: 0}", ""),
        ("not {mode: FAULT}", ""),
        ("{word: fast} -> {user: ann}", ""),
        ("{state: broken} -> {part: arm}", 'state of /rows with "broken", which it never was: it was "ok"'),
        ("once {mode: FAULT} and {topic: /cmd} -> {speed: 0}", 'mode of /mode with "FAULT"'),
        ("{topic: /hit} -> pre {mode: FAULT}", ""),
    ],
)
def test_a_text_that_is_none_of_those_of_this_robot_is_a_doubt(formula: str, doubt: str, tmp_path: Path) -> None:
    spec = spec_of(tmp_path, f"{{id: p, formula: '{formula}'}}")
    found = judge(spec, trace(tmp_path, *MODES, *OTHERS))
    assert len(found.summary["doubts"]) == (doubt != "")
    assert doubt in "".join(found.summary["doubts"])
    if found.exit == 0:
        assert found.strict == (3 if doubt else 0)


def test_another_property_tells_that_the_words_of_a_state_are_right(tmp_path: Path) -> None:
    """That is an ordinary run, without a fault; not so of names, of which each message has all."""
    others = "{id: q, formula: 'not {mode: AUTO, hit: true}'}", "{id: r, formula: '{joint: joint_0} -> {q < 1}'}"
    spec = spec_of(
        tmp_path,
        "{id: p, formula: '{mode: FAULT} -> {speed: 0}'}",
        "{id: n, formula: '{joint: joint_7} -> {q < 1}'}",
        *others,
    )
    found = judge(spec, trace(tmp_path, *MODES, *OTHERS))
    (doubt,) = found.summary["doubts"]
    assert doubt.startswith('n compares joint of /joints with "joint_7"')
    assert doubt.endswith("; nothing was asked of n")
    assert 'nothing was asked of p (`{mode: "FAULT"}` never held)' in found.said


def test_nothing_more_is_said_where_a_stream_was_silent_or_a_signal_missing(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, "{id: p, formula: '{hit} -> {speed: 0}'}", "{id: q, formula: '{user: eve} -> {speed: 0}'}")
    quiet = [{"topic": "/cmd", "x": 0.5}, *(line for line in OTHERS if line["topic"] not in ("/cmd", "/hit"))]
    found = judge(spec, trace(tmp_path, *MODES, *quiet))
    assert "/hit: no event in the recording" in found.summary["doubts"]
    assert any("the signal user was absent" in text for text in found.summary["doubts"])
    assert not [text for text in found.summary["notes"] if "nothing was asked" in text]


def test_an_empty_text_is_no_word(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, "{id: p, formula: '{mode: FAULT} -> {speed: 0}'}")
    found = judge(spec, trace(tmp_path, {"topic": "/mode", "data": ""}, *OTHERS))
    assert (found.summary["doubts"], found.strict) == ([], 0)


def test_many_of_which_nothing_was_asked_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = spec_of(tmp_path, *(f"{{id: p{i}, formula: '{{hit}} -> {{speed: {i}}}'}}" for i in range(12)))
    path = trace(tmp_path, *MODES, *OTHERS)
    assert run_replay([spec], path, None, "text", strict=True) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if "nothing was asked" in line]
    assert len(lines) == 1
    assert lines[0].endswith("p7 (`{hit}` never held) and 4 more")
    run_replay([spec], path, None, "junit", strict=True)
    suite = ElementTree.fromstring(capsys.readouterr().out).find("testsuite")
    assert suite is not None
    assert suite.get("errors") == "0"
    assert lines[0] in (suite.findtext("system-out") or "")


def test_what_held_only_at_a_deadline_was_asked(tmp_path: Path) -> None:
    spec = write_spec(
        tmp_path,
        "id: a\nstreams:\n  - {topic: /scan}\n  - {topic: /cmd, signals: {speed: msg.x}, hold: [speed]}\n"
        "derive: {quiet: {age: '{topic: /scan}'}}\nproperties:\n"
        "  - {id: p, time: seconds, formula: '{quiet > 2} -> {speed: 0}'}\n",
    )
    path = tmp_path / "trace.jsonl"
    second = 10**9
    lines = [("/cmd", 1, {"x": 0}), ("/scan", 1.5, {}), ("/scan", 9, {})]
    path.write_text(
        "".join(
            json.dumps({"stream": name, "stamp": int(at * second), "arrived": int(at * second), "data": data}) + "\n"
            for name, at, data in lines
        )
    )
    assert "nothing was asked" not in judge(spec, path).said
