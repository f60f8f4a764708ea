"""MCAP files whose summaries leave out what a summary may leave out: judged as those that have it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer

from tests.replay.judging import BASE, MS, Judgement, judge, write_spec

LEVELS = """
id: levels
ordering: {by: arrival}
streams:
  - {topic: /a, type: std_msgs/msg/Float64, signals: {v: msg.data}}
  - {topic: /b, type: std_msgs/msg/Float64, signals: {w: msg.data}}
properties:
  - {id: a_low, formula: '{topic: "/a"} -> {v < 5}'}
  - {id: b_low, formula: '{topic: "/b"} -> {w < 5}'}
"""
NUMBER = ("std_msgs/msg/Float64", "ros2msg", b"float64 data\n", "cdr")
Channel = tuple[str, str, bytes, str]
"""The name of a type, the encoding of its definition, the definition, and how the messages are encoded."""


def number(value: float) -> bytes:
    return b"\x00\x01\x00\x00" + struct.pack("<d", value)


def write(
    path: Path, other: Channel, message: bytes, *, numbers: str = "/a", counted: bool = True, **leaving_out: Any
) -> Path:
    """Five `numbers` and messages on /b; the statistics have each channel's messages where they are `counted`."""
    with path.open("wb") as out:
        writer = Writer(out, **leaving_out)
        writer.start(profile="ros2", library="test")
        ids = []
        for topic, (name, encoding, definition, serialization) in ((numbers, NUMBER), ("/b", other)):
            schema = writer.register_schema(name, encoding, definition)
            ids.append(writer.register_channel(topic, serialization, schema))
        for n in range(5):
            for channel, data in zip(ids, (number(1.0), message), strict=True):
                writer.add_message(channel, BASE + n * MS, data, BASE + n * MS)
        if not counted:
            writer._Writer__statistics.channel_message_counts = {}  # type: ignore[attr-defined]
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def of(path: Path) -> Judgement:
    return judge(write_spec(path.parent, LEVELS), path)


@pytest.mark.parametrize("counted", [True, False])
def test_other_types_are_told_whether_or_not_messages_are_counted(counted: bool, tmp_path: Path) -> None:
    whole = ("std_msgs/msg/Int32", "ros2msg", b"int32 data\n", "cdr")
    found = of(write(tmp_path / "x.mcap", whole, b"\x00\x01\x00\x00\x63\x00\x00\x00", counted=counted))
    said = "/b: its 5 messages are of the type std_msgs/msg/Int32, and the spec says std_msgs/msg/Float64"
    assert (found.exit, said in found.said) == (2, True)
    assert "should be there" not in found.said


@pytest.mark.parametrize("counted", [True, False])
def test_messages_that_are_not_read_are_told_whether_or_not_they_are_counted(counted: bool, tmp_path: Path) -> None:
    json = ("std_msgs/msg/Float64", "jsonschema", b"{}", "json")
    path = write(tmp_path / "x.mcap", json, b'{"data": 99}', counted=counted)
    found = of(path)
    assert (found.exit, found.said.count("/b: its messages are in 'json', which is not read")) == (2, 1)
    assert "should have" not in found.said


def test_what_passed_a_filter_and_is_not_read_is_told(tmp_path: Path) -> None:
    json = ("std_msgs/msg/Float64", "jsonschema", b"{}", "json")
    path = write(tmp_path / "x.mcap", json, b'{"data": 99}', numbers="/b_mon")
    text = """
    id: filtered
    streams: [{topic: /b, action: filter, type: std_msgs/msg/Float64, signals: {v: msg.data}}]
    properties: [{id: low, formula: 'historically {v < 5}', guards: [/b]}]
    """
    found = judge(write_spec(tmp_path, text), path)
    assert (found.exit, "/b: its messages are in 'json', which is not read" in found.said) == (2, True)
    assert [(row["decision"], row["passed"]) for row in found.rows] == [("allow", None)] * 5, "what passed is not known"


INTEGER = ("std_msgs/msg/Int32", "ros2msg", b"int32 data\n", "cdr")


@pytest.mark.parametrize("other", [("std_msgs/msg/Float64", "jsonschema", b"{}", "json"), INTEGER])
def test_what_is_missed_on_a_topic_that_is_not_read_is_degraded(other: Channel, tmp_path: Path) -> None:
    """A deadline runs out without what is there and can't be read; of what does not read it nothing is degraded."""
    path = write(tmp_path / "x.mcap", other, b"\x00\x01\x00\x00\x63\x00\x00\x00")
    text = """
    id: two
    streams: [{topic: /a, signals: {a: msg.data}}, {topic: /b, type: std_msgs/msg/Float64, signals: {b: msg.data}}]
    properties:
      - {id: low, formula: 'not {a > 0.5}'}
      - {id: caused, pattern: '/a causes /b within 1ms'}
      - {id: none, pattern: 'no /b'}
      - {id: turns, formula: '{a: *} -> not pre {a: *}'}
      - {id: second, formula: '{a: *} -> not once[1:1] {a: *}'}
    """
    found = judge(write_spec(tmp_path, text), path)
    assert found.summary["properties"]["caused"]["violations"] == 3
    assert {(row["property"], row["degraded"]) for row in found.rows} == {
        ("low", False), ("caused", True), ("none", True), ("turns", True), ("second", True),
    }  # fmt: skip
    assert [row["property"] for row in found.summary["unjudged"]] == ["none"]


def test_what_is_not_read_on_one_topic_keeps_no_other_from_being_judged(tmp_path: Path) -> None:
    """Properties of that topic are not judged, and all others are."""
    json = ("levels/Level", "jsonschema", b"{}", "json")
    path = write(tmp_path / "x.mcap", json, b'{"data": 99}')
    text = """
    id: two
    streams: [{topic: /a, signals: {a: msg.data}}, {topic: /b, signals: {b: msg.data}}]
    properties: [{id: low, formula: 'not {a > 0.5}'}, {id: other, formula: 'not {b > 5}'}]
    """
    found = judge(write_spec(tmp_path, text), path)
    assert (found.exit, found.summary["properties"]["low"]["violations"]) == (2, 1)
    assert [(row["property"], row["reason"]) for row in found.summary["unjudged"]] == [
        ("other", "/b: its messages are in 'json', which is not read")
    ]


LEFT_OUT: dict[str, dict[str, Any]] = {
    "nothing": {},
    "numbers of messages": {"counted": False},
    "schemas": {"repeat_schemas": False},
    "schemas and statistics": {"repeat_schemas": False, "use_statistics": False},
    "schemas and numbers": {"repeat_schemas": False, "counted": False},
    "schemas and channels": {"repeat_schemas": False, "repeat_channels": False},
    "channels": {"repeat_channels": False},
    "all, without chunks": {"repeat_schemas": False, "repeat_channels": False, "use_chunking": False},
}


@pytest.mark.parametrize("what", LEFT_OUT)
def test_what_a_summary_leaves_out_changes_nothing(what: str, tmp_path: Path) -> None:
    found = of(write(tmp_path / "x.mcap", NUMBER, number(9.0), **LEFT_OUT[what]))
    violated = {name: state["violations"] for name, state in found.summary["properties"].items()}
    assert (found.exit, found.said, violated) == (1, "", {"a_low": 0, "b_low": 5})


def test_a_type_that_a_file_does_not_tell_is_said_so(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="ros2", library="test")
        number_ = writer.register_channel("/b", "cdr", 0)
        writer.add_message(number_, BASE, number(9.0), BASE)
        writer.finish()  # type: ignore[no-untyped-call]
    found = of(path)
    assert "/b: its only message is of a type that the recording does not tell, and the spec says std" in found.said
    assert found.exit == 2
