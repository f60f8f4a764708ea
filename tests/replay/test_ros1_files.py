"""Bags of ROS 1 that `rosbag record` does not write so: without an index, encrypted, and several in one file."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from oracle_server.core.errors import TraceError
from oracle_server.replay.files.ros1file import MAGIC
from tests.replay.judging import BASE, MS, judge, write_spec

SPEC = """
id: numbers
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {x: msg.data}}]
properties: [{id: low, formula: '{topic: "/x"} -> {x <= 1000}'}]
"""
INDEX = b"op=\x04"
HEADER = b"op=\x03"


def write(path: Path, *kinds: str) -> Path:
    """A bag with ten messages of each kind on `/x`, all of them small."""
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as writer:
        connections = [writer.add_connection("/x", f"std_msgs/msg/{kind}", typestore=store) for kind in kinds]
        for at in range(10):
            for connection in connections:
                message = store.types[connection.msgtype](data=at)
                writer.write(connection, BASE + at * 100 * MS, store.serialize_ros1(message, connection.msgtype))
    return path


def records(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The heading of each record of a bag, and all of the record."""
    at = len(MAGIC)
    while at < len(data):
        (head,) = struct.unpack_from("<I", data, at)
        (length,) = struct.unpack_from("<I", data, at + 4 + head)
        yield data[at + 4 : at + 4 + head], data[at : (at := at + 8 + head + length)]


def without_index(path: Path) -> Path:
    """The same bag without the indexes behind its chunks, as some programs write them."""
    data = path.read_bytes()
    lacking = sum(len(record) for head, record in records(data) if INDEX in head)
    assert lacking
    kept = bytearray(MAGIC + b"".join(record for head, record in records(data) if INDEX not in head))
    at = kept.index(b"index_pos=") + len(b"index_pos=")
    (before,) = struct.unpack_from("<Q", kept, at)
    struct.pack_into("<Q", kept, at, before - lacking)
    path.write_bytes(kept)
    return path


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    return write_spec(tmp_path, SPEC)


def test_a_bag_without_an_index_is_judged_and_nothing_is_said(spec: Path, tmp_path: Path) -> None:
    found = judge(spec, without_index(write(tmp_path / "x.bag", "Float64")))
    assert (found.summary["events"], found.said, found.strict) == (10, "", 0)


@pytest.mark.parametrize(("kinds", "which"), [(("Float64", "Int32"), "10 of its 20"), (("Int32",), "its 10")])
def test_messages_of_another_type_are_said_without_an_index(
    kinds: tuple[str, ...], which: str, spec: Path, tmp_path: Path
) -> None:
    """They were passed over, with exit status 0, as none was counted."""
    found = judge(spec, without_index(write(tmp_path / "x.bag", *kinds)))
    assert f"/x: {which} messages are of the type std_msgs/msg/Int32" in str(found.summary)
    assert found.exit == 2


def test_an_encrypted_bag_is_told_as_one(spec: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "x.bag", "Float64")
    parts = []
    for head, record in records(path.read_bytes()):
        if HEADER in head:
            field = b"encryptor=rosbag/AesCbcEncryptor"
            more = head + struct.pack("<I", len(field)) + field
            padding = record[8 + len(head) + len(field) + 4 :]
            parts.append(struct.pack("<I", len(more)) + more + struct.pack("<I", len(padding)) + padding)
        else:
            parts.append(record)
    path.write_bytes(MAGIC + b"".join(parts))
    with pytest.raises(TraceError, match=r"is encrypted \(rosbag/AesCbcEncryptor\), which is not read"):
        judge(spec, path)


def test_a_bag_behind_another_in_one_file_is_said(spec: Path, tmp_path: Path) -> None:
    """It was told that the bag had not been closed."""
    one, other = (write(tmp_path / name, "Float64").read_bytes() for name in ("one.bag", "other.bag"))
    path = tmp_path / "both.bag"
    path.write_bytes(one + other)
    found = judge(spec, path)
    assert found.said == f"both.bag: has {len(other)} bytes behind its end that were not read, as of another bag"
    assert (found.summary["events"], found.exit, found.strict) == (10, 0, 3)


def test_a_bag_that_was_cut_anywhere_behind_its_chunks_was_not_closed(spec: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "x.bag", "Float64")
    data = path.read_bytes()
    for cut in (1, 30, 60):
        path.write_bytes(data[:-cut])
        assert f"of {len(data) - cut}: the bag was not closed" in judge(spec, path).said
