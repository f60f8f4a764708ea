"""Messages of a bag as plain data, which must be as an adapter would have sent them."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from oracle_server.replay.bagmessages import message_reader

TEXT = "float64 from\nbool pass\nint32 self\n"


def read(text: str, raw: bytes, paths: list[str] | None) -> dict[str, Any]:
    """What is read of a message of ROS 1, by its definition."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, "my_msgs/msg/Move"))
    found: dict[str, Any] = message_reader(store, "my_msgs/msg/Move", paths)(
        store.deserialize_ros1(raw, "my_msgs/msg/Move")
    )
    return found


@pytest.mark.parametrize("paths", [["from", "pass", "self"], None])
def test_fields_that_are_words_of_pythons_are_read_by_their_names(paths: list[str] | None) -> None:
    assert read(TEXT, struct.pack("<d?i", 9.5, True, 3), paths) == {"from": 9.5, "pass": True, "self": 3}
