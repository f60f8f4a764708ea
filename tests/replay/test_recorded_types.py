"""A recording whose messages are of other types than the spec's is no recording of the spec."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from oracle_server.replay.command import run_replay
from tests.replay.judging import BASE, MS, judge, write_spec

SPEC = """
id: lamp
ordering: {{by: arrival}}
streams:
  - {{topic: /armed, {type}signals: {{armed: msg.data}}}}
properties:
  - {{id: never_armed, formula: 'not {{armed: true}}'}}
"""


def spec(folder: Path, name: str = "std_msgs/msg/Bool") -> Path:
    return write_spec(folder, SPEC.format(type=f"type: {name}, " if name else ""))


def bag(path: Path, messages: list[tuple[str, Any]]) -> Path:
    """A bag of /armed with messages of these types."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        ids = {
            name: writer.add_connection("/armed", name, typestore=store)
            for name in dict.fromkeys(name for name, _ in messages)
        }
        for n, (name, value) in enumerate(messages, 1):
            raw = store.serialize_cdr(store.types[name](data=value), name)
            writer.write(ids[name], BASE + n * MS, raw)
    return path


def log(folder: Path, *messages: dict[str, Any], topic: str = "/armed") -> Path:
    path = folder / "trace.jsonl"
    lines = [{"stream": topic, "stamp": n, "arrived": n, "data": data} for n, data in enumerate(messages, 1)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def test_a_topic_of_another_type_is_not_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = bag(tmp_path / "bag", [("std_msgs/msg/String", "true")] * 3)
    found = judge(spec(tmp_path), recording)
    said = "/armed: its 3 messages are of the type std_msgs/msg/String, and the spec says std_msgs/msg/Bool"
    assert (found.exit, found.strict, found.rows) == (2, 2, [])
    assert said in found.said
    assert "no event" not in found.said
    assert run_replay([spec(tmp_path)], recording, None, "text") == 2
    assert said in capsys.readouterr().err


def test_of_two_types_the_spec_says_which_is_judged(tmp_path: Path) -> None:
    recording = bag(tmp_path / "bag", [("std_msgs/msg/Bool", False), ("std_msgs/msg/String", "true")])
    found = judge(spec(tmp_path), recording)
    assert (found.exit, found.strict, len(found.rows)) == (2, 2, 1)
    assert "its only message of the type std_msgs/msg/String" not in found.said
    assert "/armed: 1 of its 2 messages is of the type std_msgs/msg/String, and the spec says" in found.said
    assert "could be read" not in found.said
    found = judge(spec(tmp_path, ""), recording)
    assert (found.exit, found.strict) == (0, 3)
    assert "/armed: has messages of 2 types: std_msgs/msg/Bool, std_msgs/msg/String" in found.said


@pytest.mark.parametrize("name", ["std_msgs/Bool", "std_msgs.msg.Bool", "std_msgs/msg/Bool", ""])
def test_a_type_has_the_same_name_in_both_versions_of_ros(name: str, tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(tmp_path / "one.bag") as writer:
        connection = writer.add_connection("/armed", "std_msgs/msg/Bool", typestore=store)
        raw = store.serialize_ros1(store.types["std_msgs/msg/Bool"](data=False), "std_msgs/msg/Bool")
        writer.write(connection, BASE, raw)
    for recording in (tmp_path / "one.bag", bag(tmp_path / "two", [("std_msgs/msg/Bool", False)])):
        found = judge(spec(tmp_path, name), recording)
        assert (found.exit, found.strict, found.said) == (0, 0, "")


TWIST = {"linear": {"x": 9.0, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}
CONTRADICTING: dict[str, tuple[str, dict[str, Any], str]] = {
    "a text for a boolean": ("std_msgs/msg/Bool", {"data": "true"}, "`data` is 'true', where the type has a bool"),
    "a number for a boolean": ("std_msgs/msg/Bool", {"data": 1}, "`data` is 1, where the type has a bool"),
    "a text for a number": ("std_msgs/msg/Float64", {"data": "1.5"}, "`data` is '1.5', where the type has a float64"),
    "a boolean for a number": ("std_msgs/msg/Float64", {"data": True}, "`data` is true, where the type has a float64"),
    "a part of a number": ("std_msgs/msg/Int32", {"data": 1.5}, "`data` is 1.5, where the type has an int32"),
    "a number for a text": ("std_msgs/msg/String", {"data": 5}, "`data` is 5, where the type has a string"),
    "another message": (
        "geometry_msgs/msg/TwistStamped",
        TWIST,
        "it has angular and linear, and geometry_msgs/msg/TwistStamped has header and twist",
    ),
    "another message inside": (
        "geometry_msgs/msg/TwistStamped",
        {"twist": {"x": 1.0}},
        "`twist` has x, and geometry_msgs/msg/Twist has angular and linear",
    ),
    "a message for a value": (
        "std_msgs/msg/Bool",
        {"data": {"data": True}},
        "`data` is a message, where the type has a bool",
    ),
    "a value for a message": (
        "geometry_msgs/msg/TwistStamped",
        {"twist": 5.0},
        "`twist` is 5.0, where the type has a geometry_msgs/msg/Twist",
    ),
    "a value for a list": ("sensor_msgs/msg/LaserScan", {"ranges": 5.0}, "`ranges` is 5.0, where the type has a list"),
    "texts in a list": (
        "sensor_msgs/msg/LaserScan",
        {"ranges": ["a"]},
        "`ranges[0]` is 'a', where the type has a float32",
    ),
}


@pytest.mark.parametrize("case", CONTRADICTING)
def test_a_message_that_contradicts_its_type_is_told(case: str, tmp_path: Path) -> None:
    name, data, reason = CONTRADICTING[case]
    text = SPEC.format(type=f"type: {name}, ").replace("armed: msg.data", "armed: 1 == 1")
    found = judge(write_spec(tmp_path, text), log(tmp_path, data, data))
    assert (found.exit, found.strict) == (2, 2)
    assert f"/armed: its 2 messages are no {name}: {reason}" in found.said


FITTING: list[tuple[str, dict[str, Any]]] = [
    ("std_msgs/msg/Float64", {"data": 1}),
    ("std_msgs/msg/Float64", {"data": "NaN"}),
    ("std_msgs/msg/Float64", {"data": None}),
    ("std_msgs/msg/Int32", {"data": 2.0}),
    ("std_msgs/msg/Bool", {"data": True, "verdict": "currently_true"}),
    ("std_msgs/msg/Bool", {}),
    ("std_msgs/msg/Empty", {"verdict": "true"}),
    ("std_msgs/msg/UInt8MultiArray", {"data": "AQI="}),
    ("std_msgs/msg/UInt8MultiArray", {"data": [1, 2]}),
    ("geometry_msgs/msg/TwistStamped", {"twist": TWIST}),
    ("std_msgs/msg/Header", {"seq": 4, "stamp": {"secs": 1, "nsecs": 2}}),
    ("std_msgs/msg/Header", {"stamp": {"sec": 1, "nanosec": 2}}),
    ("std_msgs/msg/Header", {"stamp": 12.5}),
    ("other_msgs/msg/Unknown", {"data": 5}),
    ("sensor_msgs/msg/LaserScan", {"ranges": [1, "Infinity"]}),
]


@pytest.mark.parametrize(("name", "data"), FITTING)
def test_what_a_type_allows_is_no_contradiction(name: str, data: dict[str, Any], tmp_path: Path) -> None:
    text = SPEC.format(type=f"type: {name}, ").replace("armed: msg.data", "armed: 1 == 2")
    found = judge(write_spec(tmp_path, text), log(tmp_path, data))
    assert (found.exit, found.strict, found.said) == (0, 0, "")


LIMIT = """
id: limit
streams:
  - {{topic: /cmd, type: {type}, {signals}}}
properties:
  - {{id: slow, formula: 'not {{topic: "/cmd", v > 9}}'}}
"""


def limited(
    folder: Path, *data: dict[str, Any], read: str = "msg.linear.x", name: str = "geometry_msgs/msg/Twist"
) -> Any:
    path = folder / "log.txt"
    lines = [{"topic": "cmd", "time": n + 1.0, **fields} for n, fields in enumerate(data)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    signals = f"signals: {{v: '{read}'}}" if read else ""
    return judge(write_spec(folder, LIMIT.format(type=name, signals=signals)), path)


LACKING: dict[str, tuple[dict[str, Any], str]] = {
    "another field": ({"linear": {"vx": 5.0, "y": 0, "z": 0}, "angular": TWIST["angular"]}, "linear.x"),
    "another case": ({"Linear": {"x": 5.0}, "angular": TWIST["angular"]}, "linear"),
    "an empty message": ({"linear": {}}, "linear.x"),
    "nothing": ({}, "linear"),
}


@pytest.mark.parametrize("case", LACKING)
def test_a_message_without_a_field_that_is_read_is_said(case: str, tmp_path: Path) -> None:
    data, field = LACKING[case]
    found = limited(tmp_path, TWIST, data, TWIST, data)
    assert (found.exit, found.strict) == (0, 3)
    assert found.summary["notes"] == [
        f"{tmp_path / 'log.txt'}:2: /cmd: it has no `{field}`, which each geometry_msgs/msg/Twist has: "
        "what reads it is absent there (2 such lines)"
    ]


WHOLE: dict[str, tuple[str, str, dict[str, Any]]] = {
    "only what is read": ("geometry_msgs/msg/Twist", "msg.linear.x", {"linear": {"x": 0.5}}),
    "null": ("geometry_msgs/msg/Twist", "msg.linear.x", {"linear": {"x": None}}),
    "null around it": ("geometry_msgs/msg/Twist", "msg.linear.x", {"linear": None}),
    "a time of ROS 1": ("std_msgs/msg/Header", "msg.stamp.sec", {"stamp": {"secs": 1, "nsecs": 2}}),
    "a time as a number": ("std_msgs/msg/Header", "msg.stamp.sec", {"stamp": 1.5}),
    "what ROS 1 alone has": ("std_msgs/msg/Header", "msg.seq", {"frame_id": "map"}),
    "an item of a list": ("tf2_msgs/msg/TFMessage", "msg.transforms[0].transform.translation.x", {"transforms": []}),
    "what the spec asks for": (
        "geometry_msgs/msg/Twist",
        "has(msg.linear.x) ? msg.linear.x : 0.0",
        {"linear": {"y": 0}},
    ),
    "no known type": ("other_msgs/msg/Unknown", "msg.speed.x", {"pace": 1}),
}


@pytest.mark.parametrize("case", WHOLE)
def test_a_message_with_what_is_read_lacks_nothing(case: str, tmp_path: Path) -> None:
    name, read, data = WHOLE[case]
    assert ", which each " not in limited(tmp_path, data, data, read=read, name=name).said


def test_what_formulas_read_of_a_stream_without_signals_may_be_missing_too(tmp_path: Path) -> None:
    text = LIMIT.format(type="std_msgs/msg/Float64", signals="").replace("v > 9", "data > 9")
    path = log(tmp_path, {"data": 0.5}, {"date": 5.0, "verdict": "true"})
    path.write_text(path.read_text().replace("armed", "cmd"))
    found = judge(write_spec(tmp_path, text), path)
    assert "`data`" in found.said
    assert found.strict != 0


def test_one_message_of_many_is_enough(tmp_path: Path) -> None:
    found = judge(spec(tmp_path), log(tmp_path, {"data": False}, {"data": "x"}, {"data": False}))
    assert found.exit == 2
    assert "/armed: 1 of its 3 messages is no std_msgs/msg/Bool: `data` is 'x'" in found.said


SCENE = b"\n\xb2\x02\n\x15foxglove/Scene.proto\x12\xff\xfe"
"""How a schema of protobuf looks, which is no text."""


def mixed(path: Path, definition: bytes, topics: dict[str, tuple[str, bytes]]) -> Path:
    """An MCAP file of /armed, and of other topics, each with the encoding and the text of its schema."""
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="ros2", library="test")
        bool_ = writer.register_schema("std_msgs/msg/Bool", "ros2msg", definition)
        ids = {writer.register_channel("/armed", "cdr", bool_): b"\0\1\0\0\0"}
        for topic, (encoding, text) in topics.items():
            schema = writer.register_schema("foxglove.SceneUpdate", encoding, text)
            ids[writer.register_channel(topic, encoding, schema)] = b"\x0a\x01"
        for at in range(20):
            for channel, raw in ids.items():
                writer.add_message(channel, BASE + at * MS, raw, BASE + at * MS)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def test_a_schema_beside_the_specs_need_be_no_text(tmp_path: Path) -> None:
    found = judge(spec(tmp_path), mixed(tmp_path / "x.mcap", b"bool data\n", {"/scene": ("protobuf", SCENE)}))
    assert (found.exit, found.strict, found.said) == (0, 0, "")
    assert len(found.rows) == 20
    assert not any(row["degraded"] for row in found.rows)


def test_a_comment_of_a_definition_may_be_in_another_encoding(tmp_path: Path) -> None:
    path = mixed(tmp_path / "x.mcap", "# größer als 5 °C\nbool data\n".encode("latin-1"), {})
    found = judge(spec(tmp_path), path)
    assert (len(found.rows), found.exit, found.strict, found.said) == (20, 0, 0, "")
