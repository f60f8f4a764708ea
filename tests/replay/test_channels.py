"""Channels that a recording does not tell, or tells of two topics: whose messages they are is not known."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from io import BytesIO
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin

from tests.replay.judging import BASE, judge, write_numbers, write_spec
from tests.replay.test_damaged import MANY, NUMBERS
from tests.replay.writing import SPEC, write_ros1


@pytest.mark.parametrize("form", ["mcap", "db3", "bag"])
def test_messages_whose_topic_is_not_told_are_said(form: str, tmp_path: Path) -> None:
    """As where the part is damaged that tells it: they may be the ones that the spec is about."""
    if form == "bag":
        path, told = write_ros1(tmp_path / "x.bag", 30), "channel 9"
        data = path.read_bytes()
        at = data.index(b"conn=", data.index(b"op=\x02") - 40) + 5
        path.write_bytes(data[:at] + b"\x09" + data[at + 1 :])
    elif form == "db3":
        bag, told = write_numbers(tmp_path / "bag", {"/x": MANY}, StoragePlugin.SQLITE3), "topics that it does not name"
        (path,) = bag.glob("*.db3")
        with closing(sqlite3.connect(path)) as database, database:
            database.execute("UPDATE messages SET topic_id = 9 WHERE id = 7")
    else:
        path, told = tmp_path / "x.mcap", "channel 9"
        with path.open("wb") as out:
            writer = Writer(out)
            writer.start(profile="ros2", library="test")
            schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
            channel = writer.register_channel("/x", "cdr", schema)
            for at in range(20):
                writer.add_message(channel if at % 5 else 9, BASE + at, b"\0\1\0\0" + bytes(8), BASE + at)
            writer.finish()  # type: ignore[no-untyped-call]
    text = SPEC if form == "bag" else NUMBERS
    found = judge(write_spec(tmp_path, text), path)
    assert found.said.count(told) == 1, found.said
    assert found.strict != 0


def test_a_channel_of_two_topics_is_said(tmp_path: Path) -> None:
    """As of files that were put together: each has numbers of its own."""
    path, data = tmp_path / "x.mcap", b""
    for topic in ("/x", "/y"):
        out = BytesIO()
        writer = Writer(out, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
        channel = writer.register_channel(topic, "cdr", schema)
        writer.add_message(channel, BASE, b"\0\1\0\0" + bytes(8), BASE)
        writer.finish()  # type: ignore[no-untyped-call]
        found = out.getvalue()
        at = found.index(b"\x06", 8 + 9 + int.from_bytes(found[9:17], "little"))  # the chunk behind the header
        end = at + 9 + int.from_bytes(found[at + 1 : at + 9], "little")
        data = data or found[:at]
        data += found[at:end]
    path.write_bytes(data)
    said = judge(write_spec(tmp_path, NUMBERS), path).said
    assert "x.mcap: tells two topics of channel 1, /x and /y" in said
