"""How the messages of bags are serialized: what stands behind their ends, and what is not read at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from oracle_server.core.errors import TraceError
from oracle_server.replay.files.blocks import ZSTD
from tests.replay.judging import BASE, MS, Judgement, judge, write_spec

STORE = get_typestore(Stores.LATEST)
ARM = """
id: arm
streams: [{topic: /joints, type: sensor_msgs/msg/JointState, signals: {lift: 'msg.position[0]'}}]
properties: [{id: low, formula: 'not {lift > 0.85}'}]
"""
JOINTS = b"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
"""
GARBAGE = b"\xf4\x7f\x00\x00\xf0\xd5\x8d\x89" * 40


def joints(lift: float, order: str = "le") -> bytes:
    made: dict[str, Any] = STORE.types
    header = made["std_msgs/msg/Header"](stamp=made["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="base")
    one, none = np.array([lift]), np.array([])
    message = made["sensor_msgs/msg/JointState"](header=header, name=["lift"], position=one, velocity=none, effort=none)
    return bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/JointState", little_endian=order == "le"))


def write(path: Path, topic: str, messages: list[bytes], *, schema: tuple[str, str, bytes] | None, how: str) -> Path:
    """An MCAP file with messages 100 ms apart, of a schema: its name, its encoding and its text."""
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="", library="test")
        known = 0 if schema is None else writer.register_schema(*schema)
        channel = writer.register_channel(topic, how, known)
        for n, raw in enumerate(messages):
            writer.add_message(channel, BASE + n * 100 * MS, raw, BASE + n * 100 * MS)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def of_arm(folder: Path, messages: list[bytes]) -> Judgement:
    schema = ("sensor_msgs/msg/JointState", "ros2msg", JOINTS)
    path = write(folder / "arm.mcap", "/joints", messages, schema=schema, how="cdr")
    return judge(write_spec(folder, ARM), path)


@pytest.mark.parametrize("order", ["le", "be"])
@pytest.mark.parametrize("tail", [4, 8, 16, 300])
def test_what_stands_behind_a_message_is_no_part_of_it(tail: int, order: str, tmp_path: Path) -> None:
    """`rclpy.serialization.serialize_message` leaves it there, with whatever was in memory."""
    found = of_arm(tmp_path, [joints(n / 10, order) + GARBAGE[:tail] for n in range(10)])
    assert (found.exit, found.said) == (1, "")
    assert [row["step"] for row in found.rows if row["violation"]] == [10]
    assert found.summary["events"] == 10


SPEC = """
id: x
streams: [{topic: /x, signals: {v: msg.data}}]
properties: [{id: low, formula: 'not {v > 5}'}]
"""


def test_a_message_that_is_longer_than_all_of_its_type_is_of_another(tmp_path: Path) -> None:
    schema = ("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
    path = write(tmp_path / "x.mcap", "/x", [b"\0\1\0\0" + b"\0" * 16], schema=schema, how="cdr")
    found = judge(write_spec(tmp_path, SPEC), path)
    assert (found.exit, "it has 16 bytes, where each std_msgs/msg/Float64 has 8" in found.said) == (2, True)


def test_cdr_of_another_kind_is_told(tmp_path: Path) -> None:
    schema = ("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
    path = write(tmp_path / "x.mcap", "/x", [b"\0\6\0\0" + b"\0" * 8], schema=schema, how="cdr")
    found = judge(write_spec(tmp_path, SPEC), path)
    assert (found.exit, "it begins with the bytes 00 06" in found.said) == (2, True)


UNREAD: dict[str, tuple[tuple[str, str, bytes] | None, str, str]] = {
    "protobuf": (("foxglove.Pose", "protobuf", b"\n"), "protobuf", "its messages are in 'protobuf', which is not read"),
    "json": (("odd", "jsonschema", b"{}"), "json", "its messages are in 'json', which is not read"),
    "json without a schema": (None, "json", "its messages are in 'json', which is not read"),
    "cdr without a schema": (None, "cdr", "the recording does not tell the type of its messages"),
    "wide text": (("p/msg/T", "ros2msg", b"int32 a\nwstring b\n"), "cdr", "`b` of p/msg/T is of the type wstring"),
    "wide texts": (("p/msg/T", "ros2msg", b"wstring[] b\n"), "cdr", "`b` of p/msg/T is of the type wstring"),
    "wide text within": (
        ("p/msg/T", "ros2msg", b"Own own\n" + b"=" * 80 + b"\nMSG: p/Own\nwstring b\n"),
        "cdr", "`b` of p/msg/Own is of the type wstring",
    ),
    "short wide text": (("p/msg/T", "ros2msg", b"wstring<=5 b\n"), "cdr", "p/msg/T has a field of the type wstring"),
    "wide text in IDL": (
        ("p/msg/T", "ros2idl", b"module p { module msg { struct T { wstring b; }; }; };"),
        "cdr", "`b` of p/msg/T is of the type wstring",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", UNREAD)
def test_why_messages_are_not_read_is_told_without_advice_that_does_not_help(name: str, tmp_path: Path) -> None:
    schema, how, why = UNREAD[name]
    path = write(tmp_path / "x.mcap", "/x", [b"{}"], schema=schema, how=how)
    with pytest.raises(TraceError) as told:
        judge(write_spec(tmp_path, SPEC), path)
    assert "x.mcap: /x: " in str(told.value)
    assert why in str(told.value)
    assert "--types" not in str(told.value)


def test_messages_that_are_compressed_one_by_one_are_read_without_the_metadata_that_says_so(tmp_path: Path) -> None:
    """A file of such a bag alone, and what a recorder left that was killed, have no metadata."""
    found = of_arm(tmp_path, [zstandard.compress(joints(n / 10)) for n in range(10)])
    assert (found.exit, found.said) == (1, "")
    assert [row["step"] for row in found.rows if row["violation"]] == [10]


@pytest.mark.parametrize("told", [True, False])
def test_a_compressed_message_that_is_too_large_is_not_made(
    told: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some kilobytes may say that they are of many gigabytes, or be it without a word."""
    monkeypatch.setattr("oracle_server.replay.bags.sources._LARGEST", 10_000)
    compress = zstandard.ZstdCompressor(write_content_size=told).compress
    found = of_arm(tmp_path, [compress(joints(0.5)), compress(joints(0.9) + bytes(20_000))])
    (unjudged,) = found.summary["unjudged"]
    assert (found.exit, "1 of its 2 messages could not be read: " in unjudged["reason"]) == (3, True)


def test_a_message_of_ros1_that_begins_as_what_is_compressed_is_read_as_it_stands(tmp_path: Path) -> None:
    schema = ("std_msgs/UInt32", "ros1msg", b"uint32 data\n")
    path = write(tmp_path / "x.mcap", "/x", [ZSTD], schema=schema, how="ros1")
    found = judge(write_spec(tmp_path, SPEC.replace("> 5", "= 4247762216")), path)
    assert (found.exit, found.said) == (1, "")
