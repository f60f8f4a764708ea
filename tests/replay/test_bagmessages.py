"""Messages of a bag as plain data, which must be as an adapter would have sent them."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from oracle_server.replay.bagmessages import message_reader, ros1_decoder

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


def test_bytes_of_ros_1_are_signed_numbers_but_for_unsigned_ones() -> None:
    text, raw = (
        "byte[] a\nbyte[2] b\nuint8[] c\nchar[] d\n",
        struct.pack("<I2b2bI2BI2B", 2, 5, -3, 1, -1, 2, 1, 255, 2, 0, 9),
    )
    assert read(text, raw, None) == {"a": [5, -3], "b": [1, -1], "c": "Af8=", "d": "AAk="}


@pytest.mark.parametrize("paths", [["from", "pass", "self"], None])
def test_fields_that_are_words_of_pythons_are_read_by_their_names(paths: list[str] | None) -> None:
    assert read(TEXT, struct.pack("<d?i", 9.5, True, 3), paths) == {"from": 9.5, "pass": True, "self": 3}
