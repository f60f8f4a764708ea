"""What is to be decoded of real messages: lists that nothing reads, or that no frame holds, are left out."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracle_adapter import dumps
from oracle_ros1.codec import ARRAY, reader, sent_name, types_of
from oracle_ros1.definitions import lookup_installed
from oracle_ros1.layout import screener

from tests.ros1.test_codec import TYPES, messages, raw
from tests.ros1.test_decoding import header, observed, taken

FRAME = 2**20


def paths_of(kind: Any) -> list[str]:
    """All dotted paths into a type."""
    found = []
    for slot, inner in types_of(kind).items():
        found.append(sent_name(slot))
        if "/" in inner and not ARRAY.fullmatch(inner):
            found += [f"{sent_name(slot)}.{path}" for path in paths_of(lookup_installed(inner))]
    return found


@given(
    name=st.sampled_from([name for name in TYPES if name != "std_msgs/Empty"]), many=st.integers(0, 60), data=st.data()
)
def test_what_is_read_is_all_there_whatever_is_left_out(name: str, many: int, data: st.DataObject) -> None:
    message = data.draw(messages(name))
    for slot, kind in types_of(type(message)).items():
        if kind.endswith("[]"):
            setattr(message, slot, getattr(message, slot)[:1] * many)
    fields = data.draw(st.lists(st.sampled_from(paths_of(type(message))), max_size=3))
    serialized = raw(message)
    screened, is_too_long = screener(type(message), fields, lookup_installed)(serialized)
    read = reader(type(message), fields, lookup_installed)
    found, whole = (type(message)().deserialize(one) for one in (screened, serialized))
    assert dumps(read(found)) == dumps(read(whole))
    assert len(screened) <= len(serialized)
    assert not is_too_long


def test_a_message_that_ends_too_soon_is_left_as_it_is() -> None:
    whole = raw(path(100))
    screen = screener(type(path(1)), [], lookup_installed)
    assert len(screen(whole)[0]) < len(whole)
    for size in range(len(whole)):
        assert screen(whole[:size]) == (whole[:size], False)


def path(count: int) -> Any:
    """A path of so many poses."""
    made, pose = lookup_installed("nav_msgs/Path")(), lookup_installed("geometry_msgs/PoseStamped")()
    made.header.frame_id, pose.header.frame_id = "odom", "map"
    made.header.stamp.secs = 7
    made.poses = [pose] * count
    return made


@pytest.mark.parametrize(
    ("fields", "large"), [(["header.frame_id"], False), (["header.frame_id", "poses"], True), (None, True)]
)
def test_an_event_is_made_without_the_poses_that_nothing_reads_or_that_no_frame_holds(
    monkeypatch: pytest.MonkeyPatch, fields: list[str], large: bool
) -> None:
    message = path(20_000)
    topic, kind, made = observed("nav_msgs/msg/Path", fields, FRAME), type(message), []
    decode = kind.deserialize

    def deserialize(self: Any, serialized: bytes) -> Any:
        made.append(decode(self, serialized))
        return made[-1]

    monkeypatch.setattr(kind, "deserialize", deserialize)
    event = taken(topic, message, header(kind, "/planner"))
    assert event is not None
    assert (event[0], len(event[1]) > FRAME) == (7 * 10**9, large)
    assert large or event[1] == {"header": {"frame_id": "odom"}}
    assert [len(one.poses) for one in made] == [0]


@pytest.mark.parametrize("name", ["UInt8MultiArray", "ByteMultiArray", "Int64MultiArray"])
def test_a_list_is_whole_where_a_frame_may_hold_it(name: str) -> None:
    kind, most = lookup_installed(f"std_msgs/{name}"), 300
    read, screen = reader(kind, ["data"], lookup_installed), screener(kind, ["data"], lookup_installed, most)
    whole = 0
    for count in range(most):
        message = kind(data=bytes(count) if name.startswith("U") else [0] * count)
        screened, is_too_long = screen(raw(message))
        assert len(dumps(read(message))) > most if is_too_long else screened == raw(message)
        whole += not is_too_long
    assert most // 4 <= whole < most
