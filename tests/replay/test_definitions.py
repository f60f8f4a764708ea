"""The types of recorded messages: from the bag where it has them, else from those on hand."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from oracle_server.core.errors import TraceError
from oracle_server.replay.bags.actiontypes import action_types
from oracle_server.replay.bags.definitions import RULE, type_name, types_of
from oracle_server.replay.bags.sources import read_cdr
from oracle_server.replay.files.storage import Channel
from oracle_server.rostypes.bagtypes import typestore

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


def test_a_definition_that_can_not_be_read_gives_way_to_none_of_its_name() -> None:
    """It may be laid out otherwise: here red would be taken for what is opaque."""
    odd = channel("std_msgs/msg/ColorRGBA", "float32 a\nfloat32 r\nfloat32 g\nfloat32 b\n%% no line\n")
    with pytest.raises(TraceError, match="/x: the recording's definition of std_msgs/msg/ColorRGBA can't be read: "):
        types_of(odd, KNOWN)


def test_it_gives_way_to_that_of_a_folder_that_was_named(tmp_path: Path) -> None:
    (tmp_path / "std_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "std_msgs" / "msg" / "ColorRGBA.msg").write_text("float32 a\nfloat32 r\nfloat32 g\nfloat32 b\n")
    types = types_of(channel("std_msgs/msg/ColorRGBA", "%% no line\n"), typestore([tmp_path]))
    assert [name for name, _ in types.fielddefs["std_msgs/msg/ColorRGBA"][1]] == ["a", "r", "g", "b"]


@pytest.mark.parametrize("encoding", ["omgidl", "jsonschema", "protobuf", ""])
def test_a_definition_of_a_kind_that_is_not_read_leaves_what_is_known(encoding: str) -> None:
    text = "module std_msgs {\n  module msg {\n    struct String {\n      string data;\n    };\n  };\n};\n"
    types = types_of(channel("std_msgs/msg/String", text, encoding), KNOWN)
    assert "std_msgs/msg/String" in types.fielddefs


@pytest.mark.parametrize("text", ["module std_msgs { };\n", "String data\n", "int64 data\n"])
def test_a_definition_of_a_kind_that_is_not_read_is_not_taken_for_one_that_is(text: str) -> None:
    types = types_of(channel("std_msgs/msg/String", text, "omgidl"), KNOWN)
    assert types.fielddefs["std_msgs/msg/String"] == KNOWN.fielddefs["std_msgs/msg/String"]


@pytest.mark.parametrize("name", ["Float64", "foxglove.Pose"])
def test_a_name_without_a_package_is_told_as_it_is(name: str) -> None:
    """As those of messages in JSON or protobuf."""
    assert type_name(name) == name


@pytest.mark.parametrize("encoding", ["ros1msg", "ros2msg"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_lines_of_a_definition_end_in_either_way(encoding: str, ending: str) -> None:
    rule = "=" * 80
    text = f"Inner inner\nbool ok # yes\n\n{rule}\nMSG: plant_msgs/Inner\nfloat64 level\nuint8 NONE=0\n"
    types = types_of(channel("plant_msgs/msg/Level", text.replace("\n", ending), encoding), KNOWN)
    assert [name for name, _ in types.fielddefs["plant_msgs/msg/Level"][1]] == ["inner", "ok"]
    assert [name for name, _ in types.fielddefs["plant_msgs/msg/Inner"][1]] == ["level"]


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_so_do_those_of_services_and_actions(ending: str) -> None:
    service = channel("plant_msgs/srv/Fill_Event", "float64 level\n---\nbool ok\n".replace("\n", ending))
    assert [name for name, _ in types_of(service, KNOWN).fielddefs["plant_msgs/msg/Fill_Request"][1]] == ["level"]
    text = "float64 level\n---\nbool ok\n---\nfloat64 now\n".replace("\n", ending)
    found = action_types(channel("plant_msgs/action/Fill_FeedbackMessage", text), KNOWN)
    assert found is not None
    assert [name for name, _ in found["plant_msgs/msg/Fill_Feedback"][1]] == ["now"]


def test_a_message_of_ros_1_without_fields_needs_no_definition() -> None:
    assert "std_msgs/msg/Empty" in types_of(channel("std_msgs/msg/Empty", "", "ros1msg"), KNOWN).fielddefs


def test_names_of_types() -> None:
    assert type_name("test_msgs/BasicTypes") == "test_msgs/msg/BasicTypes"
    assert type_name("a/srv/B_Event") == "a/msg/B_Event"
    assert type_name("a/msg/B_Event") == "a/msg/B_Event"


@pytest.mark.parametrize(
    ("definition", "field"),
    [
        (f"F[4000000000] a\n{RULE}MSG: odd_msgs/F\n", "a"),
        (f"uint8 b\nF[65537] a\n{RULE}MSG: odd_msgs/F\nuint8 x\n", "a"),
        ("string[20000] texts\n", "texts"),
        ("\n".join(f"F[10000] f{n}" for n in range(7)) + f"\n{RULE}MSG: odd_msgs/F\nuint8 x\n", "f6"),
    ],
)
@pytest.mark.parametrize("serialization", ["cdr", "ros1"])
def test_arrays_that_no_message_holds_are_refused(definition: str, field: str, serialization: str) -> None:
    vast = channel("odd_msgs/msg/Vast", definition)._replace(serialization=serialization)
    with pytest.raises(TraceError, match=f"the field `{field}` of odd_msgs/msg/Vast has .* which no message of ROS"):
        types_of(vast, KNOWN)


def test_so_are_parts_of_ros_1_that_take_no_bytes_however_deep_they_are() -> None:
    parts = [f"MSG: odd_msgs/T{n}\nT{n + 1}[1000] a\n" for n in range(3)]
    text = RULE.join(["T0 a\n", *parts, "MSG: odd_msgs/T3\n"])
    vast = channel("odd_msgs/msg/Vast", text, "ros1msg")._replace(serialization="ros1")
    with pytest.raises(TraceError, match="odd_msgs/msg/Vast: has more than 65536 parts without a byte"):
        types_of(vast, KNOWN)
    types_of(vast._replace(definition=f"{text}uint8 b\n"), KNOWN)  # by the bytes of a message these end


def test_large_arrays_are_read() -> None:
    text = f"F[300] a\nuint8[4000000] image\n{RULE}MSG: odd_msgs/F\nuint8[100] x\n"
    types = types_of(channel("odd_msgs/msg/Large", text), KNOWN)
    message = read_cdr(types, b"\0\1\0\0" + bytes(30_000 + 4_000_000), "odd_msgs/msg/Large")
    assert (len(message.a), len(message.image)) == (300, 4_000_000)
