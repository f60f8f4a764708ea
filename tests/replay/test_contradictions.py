"""Files that contradict themselves, as those that were put together of others: it is said, and no strict success."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer

from tests.replay.judging import BASE, MS, judge, write_spec

NUMBERS = """
id: numbers
streams: [{topic: /x, signals: {x: msg.data}}]
properties: [{id: low, formula: '{topic: "/x"} -> {x <= 1000}'}]
"""
_CHUNK, _RECORD = 6, struct.Struct("<BQ")
FLOAT, WHOLE = ("std_msgs/msg/Float64", b"float64 data\n"), ("std_msgs/msg/Int64", b"int64 data\n")


def written(schemas: list[tuple[str, bytes]], times: list[int]) -> bytes:
    """An MCAP file of these schemas, with messages of the last one on /x, each in a chunk of its own."""
    out = BytesIO()
    writer = Writer(out, chunk_size=1, compression=CompressionType.NONE)
    writer.start(profile="ros2", library="test")
    for name, text in schemas:
        schema = writer.register_schema(name, "ros2msg", text)
    channel = writer.register_channel("/x", "cdr", schema)
    for at in times:
        writer.add_message(channel, BASE + at * MS, b"\0\1\0\0" + bytes(8), BASE + at * MS)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def chunks(data: bytes) -> list[tuple[int, int]]:
    """Where chunks begin and end."""
    at, found = 8, []
    while at < len(data) - 8:
        kind, length = _RECORD.unpack_from(data, at)
        end = at + _RECORD.size + length
        found += [(at, end)] if kind == _CHUNK else []
        at = end
    return found


@pytest.mark.parametrize(
    ("schemas", "said"),
    [([WHOLE], "tells two types of schema 1, one of them std_msgs/msg/Int64"), ([FLOAT, WHOLE], "of channel 1, /x")],
)
def test_a_topic_whose_type_is_told_twice_is_said(schemas: list[tuple[str, bytes]], said: str, tmp_path: Path) -> None:
    one, other = written([FLOAT], [0, 1]), written(schemas, [2, 3])
    end = chunks(one)[-1][1]
    path = tmp_path / "x.mcap"
    path.write_bytes(one[:end] + b"".join(other[a:b] for a, b in chunks(other)))
    found = judge(write_spec(tmp_path, NUMBERS), path)
    assert "x.mcap: tells two types" in found.said
    assert said in found.said
    assert (found.exit, found.strict) == (0, 3)


def test_a_chunk_that_is_older_than_its_heading_says_is_said(tmp_path: Path) -> None:
    """Chunks are read by their headings: its messages come behind those of other chunks."""
    data = bytearray(written([FLOAT], [0, 100, 200, 300]))
    struct.pack_into("<Q", data, chunks(bytes(data))[1][0] + _RECORD.size, BASE + 250 * MS)
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    found = judge(write_spec(tmp_path, NUMBERS), path)
    assert found.said.count("has messages older than its heading says, which come behind others") == 1
    assert (found.summary["events"], found.exit, found.strict) == (4, 0, 3)
    assert [row["degraded"] for row in found.rows] == [False, False, True, True]
