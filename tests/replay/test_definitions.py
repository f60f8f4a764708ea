"""The types of recorded messages: from the bag where it has them, else from those on hand."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

from oracle_server.core.errors import TraceError
from oracle_server.replay.definitions import type_name, types_of
from oracle_server.replay.storage import Channel

KNOWN = get_typestore(Stores.LATEST)


def channel(kind: str, definition: str, encoding: str = "ros2msg") -> Channel:
    return Channel(1, "/x", kind, definition, encoding)


def test_a_type_without_fields_is_known_by_its_empty_definition() -> None:
    types = types_of(channel("odd_msgs/msg/Nothing", ""), KNOWN)
    types.deserialize_cdr(b"\x00\x01\x00\x00\x00", "odd_msgs/msg/Nothing")
    with pytest.raises(TraceError, match="--types"):
        types_of(channel("odd_msgs/msg/Nothing", "", ""), KNOWN)


def test_what_a_definition_leaves_out_is_taken_from_what_is_known() -> None:
    types = types_of(channel("odd_msgs/msg/Stamped", "std_msgs/Header header\nint32 x\n"), KNOWN)
    assert "builtin_interfaces/msg/Time" in types.fielddefs
    with pytest.raises(TraceError, match="odd_msgs/msg/Unknown, which odd_msgs/msg/Stamped contains"):
        types_of(channel("odd_msgs/msg/Stamped", "Unknown x\n"), KNOWN)


def test_a_definition_that_can_not_be_read_gives_way_to_what_is_known() -> None:
    assert "std_msgs/msg/String" in types_of(channel("std_msgs/msg/String", "string [[["), KNOWN).fielddefs


def test_names_of_types() -> None:
    assert type_name("test_msgs/BasicTypes") == "test_msgs/msg/BasicTypes"
    assert type_name("a/srv/B_Event") == "a/msg/B_Event"
    assert type_name("a/msg/B_Event") == "a/msg/B_Event"
