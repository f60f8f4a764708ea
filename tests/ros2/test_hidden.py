"""What is to be deserialized of real messages: texts that go on behind a NUL, and lists that nothing reads."""

from __future__ import annotations

import importlib
import random
import re
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

codec = pytest.importorskip("oracle_ros2.codec")
hidden = pytest.importorskip("oracle_ros2.hidden")
serialization = pytest.importorskip("rclpy.serialization")

# rclpy imports an old lark with its first message.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

TYPES = [
    "test_msgs/Strings", "test_msgs/Arrays", "test_msgs/BoundedSequences", "test_msgs/UnboundedSequences",
    "test_msgs/MultiNested", "std_msgs/String", "std_msgs/Header", "sensor_msgs/Image", "sensor_msgs/PointCloud2",
    "sensor_msgs/JointState", "nav_msgs/Path", "nav_msgs/Odometry", "nav_msgs/OccupancyGrid",
    "diagnostic_msgs/DiagnosticArray", "geometry_msgs/PolygonStamped", "std_msgs/Float32MultiArray",
    "visualization_msgs/InteractiveMarkerUpdate", "rcl_interfaces/ParameterEvent",
]  # fmt: skip
NESTED = ("test_msgs/MultiNested", "visualization_msgs/InteractiveMarkerUpdate")
"""Those whose lists have lists in lists: long ones would have millions of items."""
MARK = "a mark of its own"
_MANY = re.compile(r"sequence<(?P<of>.+?)(, (?P<most>\d+))?>|(?P<array>.+)\[(?P<size>\d+)\]")
_BITS = {"int8": -7, "int16": -15, "int32": -31, "int64": -63, "uint8": 8, "uint16": 16, "uint32": 32, "uint64": 64}


def hides(message_type: Any, serialized: bytes) -> bool:
    """Whether a text is found that goes on behind a NUL."""
    try:
        hidden.screener(message_type)(serialized)
    except hidden.HiddenTextError:
        return True
    return False


class Maker:
    """Makes messages with random values, all texts of which are counted, and the one of a number is marked."""

    def __init__(self, seed: int, marked: int = -1, most: int = 3) -> None:
        self._random, self._marked, self._most, self.texts = random.Random(seed), marked, most, 0

    def message(self, kind: str) -> Any:
        package, name = kind.split("/")
        made = getattr(importlib.import_module(f"{package}.msg"), name)()
        for field, inner in made.get_fields_and_field_types().items():
            setattr(made, field, self._value(inner))
        return made

    def _value(self, kind: str) -> Any:
        many = _MANY.fullmatch(kind)
        if many:
            size = int(many["size"]) if many["size"] else self._random.randint(0, int(many["most"] or self._most))
            return [self._value(many["of"] or many["array"]) for _ in range(size)]
        if "/" in kind:
            return self.message(kind)
        if kind.startswith("string"):
            self.texts += 1
            if self.texts == self._marked:
                return MARK + "+"
            return "".join(self._random.choices("abc dé", k=self._random.randint(0, 9)))
        if kind in _BITS:
            bits = _BITS[kind]
            return self._random.randint(-(2**-bits) if bits < 0 else 0, 2 ** abs(bits) - 1)
        if kind == "octet":
            return bytes([self._random.randrange(256)])
        return self._random.choice([True, False]) if kind == "boolean" else float(self._random.randrange(10))


@given(kind=st.sampled_from(TYPES), seed=st.integers(0, 2**32), place=st.floats(0, 1, exclude_max=True))
def test_a_nul_in_any_text_is_found_and_nothing_else_is_taken_for_one(kind: str, seed: int, place: float) -> None:
    plain = Maker(seed)
    message = plain.message(kind)
    assert not hides(type(message), serialization.serialize_message(message))
    if plain.texts:
        marked = serialization.serialize_message(Maker(seed, 1 + int(place * plain.texts)).message(kind))
        assert not hides(type(message), marked)
        assert marked.count(MARK.encode()) == 1
        assert hides(type(message), marked.replace(MARK.encode(), MARK[:-1].encode() + b"\0"))


def paths_of(message_type: Any) -> list[str]:
    """All dotted paths into a type."""
    found = []
    for name, kind in message_type.get_fields_and_field_types().items():
        found.append(name)
        if "/" in kind and not _MANY.fullmatch(kind):
            found += [f"{name}.{path}" for path in paths_of(codec.load_type(kind))]
    return found


@given(kind=st.sampled_from(TYPES), seed=st.integers(0, 2**32), data=st.data())
def test_what_is_read_is_all_there_whatever_is_left_out(kind: str, seed: int, data: st.DataObject) -> None:
    message = Maker(seed, most=2 if kind in NESTED else 30).message(kind)
    fields = data.draw(st.lists(st.sampled_from(paths_of(type(message))), max_size=3))
    serialized = serialization.serialize_message(message)
    screened, is_too_long = hidden.screener(type(message), fields)(serialized)
    read = codec.reader(type(message), fields)
    found, whole = (serialization.deserialize_message(one, type(message)) for one in (screened, serialized))
    assert read(found) == read(whole)
    assert len(screened) <= len(serialized)
    assert not is_too_long


@given(many=st.integers(20, 60), name=st.text("ab", max_size=9), seed=st.integers(0, 2**32))
def test_what_follows_lists_that_are_left_out_stays_in_line(many: int, name: str, seed: int) -> None:
    rng = random.Random(seed)
    kind = codec.load_type("visualization_msgs/msg/Marker")
    point, color = (codec.load_type(one) for one in ("geometry_msgs/msg/Point", "std_msgs/msg/ColorRGBA"))
    message = kind(ns=name, text=name, mesh_use_embedded_materials=True, frame_locked=True)
    message.points = [point(x=rng.random()) for _ in range(many)]
    message.colors = [color(r=0.5) for _ in range(rng.randrange(many))]
    message.mesh_file.data = bytes(rng.randrange(9))
    serialized = serialization.serialize_message(message)
    read = codec.reader(kind, fields := ["ns", "text", "mesh_use_embedded_materials", "lifetime", "mesh_file.data"])
    screened, _ = hidden.screener(kind, fields)(serialized)
    assert read(serialization.deserialize_message(screened, kind)) == read(message)
    assert len(screened) < len(serialized)


def path(count: int) -> Any:
    """A path of so many poses."""
    pose = codec.load_type("geometry_msgs/msg/PoseStamped")()
    pose.header.frame_id = "map"
    made = codec.load_type("nav_msgs/msg/Path")(poses=[pose] * count)
    made.header.frame_id = "odom"
    return made


@pytest.mark.parametrize("fields", [["header.frame_id"], ["header.frame_id", "poses"]])
def test_of_a_list_that_nothing_reads_or_no_frame_holds_few_items_are_left(fields: list[str]) -> None:
    message = path(20_000)
    screened, is_too_long = hidden.screener(type(message), fields, 2**20)(serialization.serialize_message(message))
    assert is_too_long == ("poses" in fields)
    found = serialization.deserialize_message(screened, type(message))
    assert found.header == message.header
    assert len(found.poses) < 8


def test_a_list_that_is_read_is_whole_where_a_frame_may_hold_it() -> None:
    message = path(100)
    screened, is_too_long = hidden.screener(type(message), ["poses"], 2**20)(serialization.serialize_message(message))
    assert not is_too_long
    assert serialization.deserialize_message(screened, type(message)) == message


def test_a_text_in_a_list_that_is_left_out_is_looked_at() -> None:
    message = path(100)
    message.poses = [*message.poses[:-1], type(message.poses[0])()]
    message.poses[-1].header.frame_id = MARK
    serialized = serialization.serialize_message(message)
    screen = hidden.screener(type(message), [])
    assert len(screen(serialized)[0]) < len(serialized)
    with pytest.raises(hidden.HiddenTextError):
        screen(serialized.replace(MARK.encode(), MARK[:-1].encode() + b"\0"))


@pytest.mark.parametrize(("fields", "large"), [(["header.frame_id"], False), (["header.frame_id", "poses"], True)])
def test_a_topic_s_event_is_made_without_the_poses_that_nothing_reads_or_that_no_frame_holds(
    monkeypatch: pytest.MonkeyPatch, fields: list[str], large: bool
) -> None:
    topics, made = pytest.importorskip("oracle_ros2.topics"), []

    def deserialize(serialized: bytes, message_type: Any) -> Any:
        made.append(serialization.deserialize_message(serialized, message_type))
        return made[-1]

    monkeypatch.setattr(topics, "deserialize_message", deserialize)
    node = SimpleNamespace(get_parameter=lambda _: SimpleNamespace(value=False))
    stream = {"name": "/plan", "kind": "topic", "type": "nav_msgs/msg/Path", "stamp": None, "latency": 0}
    observed = topics.Observed(node, {**stream, "fields": fields}, frame=2**20)
    message = path(20_000)
    message.header.stamp.sec = 7
    stamp, data, _ = observed.event(serialization.serialize_message(message), {"source_timestamp": 1})
    assert (stamp, len(data) > 2**20) == (7 * 10**9, large)
    assert large or data == {"header": {"frame_id": "odom"}}
    assert len(made[0].poses) < 8


def test_the_other_order_of_bytes_is_read_too() -> None:
    kind = type(Maker(0).message("std_msgs/String"))
    assert hides(kind, b"\0\0\0\0" + b"\0\0\0\4" + b"a\0b\0")
    assert not hides(kind, b"\0\0\0\0" + b"\0\0\0\4" + b"abc\0")


@pytest.mark.parametrize(
    "data", [b"", b"\0\1", b"\0\1\0\0", b"\0\1\0\0\1\0", b"\0\1\0\0\xff\xff\xff\xff", b"\7\0\0\0\2\0\0\0"]
)
def test_what_is_cut_short_or_in_no_form_of_dds_hides_nothing(data: bytes) -> None:
    assert not hides(type(Maker(0).message("std_msgs/String")), data)


@pytest.mark.parametrize("kind", ["std_msgs/String", "std_msgs/Int64"])
def test_what_rclpy_reads_is_in_cdr_or_refused(kind: str) -> None:
    message = Maker(0).message(kind)
    whole = bytes(serialization.serialize_message(message))
    read = []
    for form in range(256):
        serialized = bytes([0, form]) + whole[2:]
        try:
            serialization.deserialize_message(serialized, type(message))
        except Exception:  # noqa: BLE001 - whatever rclpy says of it
            continue
        read.append(form)
        if form > 1:
            with pytest.raises(hidden.OtherFormError):
                hidden.screener(type(message))(serialized)
    assert 1 in read


@pytest.mark.parametrize("kind", ["geometry_msgs/Twist", "std_msgs/Empty", "test_msgs/BoundedPlainSequences"])
def test_a_type_without_texts_hides_nothing(kind: str) -> None:
    message = Maker(0).message(kind)
    assert not hides(type(message), serialization.serialize_message(message))


def test_a_text_in_the_feedback_of_an_action_is_looked_at() -> None:
    kind = pytest.importorskip("test_msgs.action").Fibonacci.Impl.FeedbackMessage
    assert not hides(kind, serialization.serialize_message(kind()))
