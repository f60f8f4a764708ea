"""Messages of a bag as plain data, which must be as an adapter would have sent them."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from oracle_server.replay.bags.definitions import types_of
from oracle_server.replay.bags.messages import message_reader, ros1_decoder
from oracle_server.replay.bags.sources import decoder, read_cdr
from oracle_server.replay.files.storage import Channel

TEXT = "float64 from\nbool pass\nint32 self\n"


def read(text: str, raw: bytes, paths: list[str] | None) -> dict[str, Any]:
    """What is read of a message of ROS 1, by its definition."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, "my_msgs/msg/Move"))
    found: dict[str, Any] = message_reader(store, "my_msgs/msg/Move", paths, ros1=True)(
        ros1_decoder(store)(raw, "my_msgs/msg/Move")
    )
    return found


def test_texts_of_ros_1_are_read_whatever_their_bytes() -> None:
    text = "string a\nstring[] b\nuint8[] c\nInner d\n" + "=" * 80 + "\nMSG: my_msgs/Inner\nstring e\n"
    odd = struct.pack("<I4s", 4, b"caf\xe9")
    raw = odd + struct.pack("<I", 1) + odd + struct.pack("<I2B", 2, 233, 1) + odd
    assert read(text, raw, None) == {"a": "caf\ufffd", "b": ["caf\ufffd"], "c": "6QE=", "d": {"e": "caf\ufffd"}}


@pytest.mark.parametrize(("mark", "order"), [(b"\0\1\0\0", "<"), (b"\0\0\0\0", ">")])
def test_texts_of_ros_2_are_read_whatever_their_bytes(mark: bytes, order: str) -> None:
    """Messages with such a text could not be read, which live they can."""
    text = f"string a\nstring[] b\nstring[1] c\nInner[] d\n{'=' * 80}\nMSG: my_msgs/Inner\nstring<=9 e\n"
    channel = Channel(1, "/a", "my_msgs/msg/Move", text, "ros2msg")
    types = types_of(channel, get_typestore(Stores.EMPTY))
    one, odd = struct.pack(f"{order}I", 1), struct.pack(f"{order}I5s3x", 5, b"caf\xe9\0")
    raw = mark + odd + one + odd + odd + one + odd
    found = message_reader(types, channel.type, None)(decoder(channel, types)(raw, channel.type))
    assert found == {"a": "caf\ufffd", "b": ["caf\ufffd"], "c": ["caf\ufffd"], "d": [{"e": "caf\ufffd"}]}


def test_bytes_of_ros_1_are_signed_numbers_but_for_unsigned_ones() -> None:
    text, raw = (
        "byte[] a\nbyte[2] b\nuint8[] c\nchar[] d\n",
        struct.pack("<I2b2bI2BI2B", 2, 5, -3, 1, -1, 2, 1, 255, 2, 0, 9),
    )
    assert read(text, raw, None) == {"a": [5, -3], "b": [1, -1], "c": "Af8=", "d": "AAk="}


SINGLE = "byte a\nbyte b\nchar c\nuint8 d\nint8 e\n"
NESTED = f"Inner[] x\n{'=' * 80}\nMSG: my_msgs/Inner\nbyte a\n"
IDL = "module my_msgs { module msg { struct Move { octet a; octet b; char c; uint8 d; int8 e; }; }; };"


@pytest.mark.parametrize("types", [get_types_from_msg(SINGLE, "my_msgs/msg/Move"), get_types_from_idl(IDL)])
def test_a_byte_of_ros_2_is_no_signed_number(types: dict[str, Any]) -> None:
    """It was read as one, and live it is none."""
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    raw = b"\0\1\0\0" + bytes([3, 200, 200, 200, 200])
    found = message_reader(store, "my_msgs/msg/Move", None)(read_cdr(store, raw, "my_msgs/msg/Move"))
    assert found == {"a": 3, "b": 200, "c": 200, "d": 200, "e": -56}


def test_a_byte_within_other_messages_of_ros_2_is_no_signed_number() -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(NESTED, "my_msgs/msg/Move"))
    raw = b"\0\1\0\0" + struct.pack("<I2B", 2, 255, 127)
    found = message_reader(store, "my_msgs/msg/Move", None)(read_cdr(store, raw, "my_msgs/msg/Move"))
    assert found == {"x": [{"a": 255}, {"a": 127}]}


def test_a_byte_of_ros_1_is_a_signed_number() -> None:
    assert read("byte a\nchar b\n", bytes([200, 200]), None) == {"a": -56, "b": 200}


@pytest.mark.parametrize("paths", [["from", "pass", "self"], None])
def test_fields_that_are_words_of_pythons_are_read_by_their_names(paths: list[str] | None) -> None:
    assert read(TEXT, struct.pack("<d?i", 9.5, True, 3), paths) == {"from": 9.5, "pass": True, "self": 3}
