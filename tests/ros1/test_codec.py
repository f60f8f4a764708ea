"""ROS 1 messages of real types to JSON and back: nothing is lost, and what does not fit is told by its field."""

from __future__ import annotations

import io
import json
import math
import re
from typing import Any

import genpy
import genpy.dynamic
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle_adapter import dumps
from oracle_ros1 import codec
from oracle_ros1.definitions import installed_message, lookup_installed, sent_definition
from oracle_ros1.stamps import stamp_reader

TYPES = [
    *(f"std_msgs/{name}" for name in ("Header", "String", "ColorRGBA", "Int64MultiArray", "UInt8MultiArray", "Byte")),
    *(
        f"std_msgs/{name}"
        for name in ("Char", "UInt64", "Float32", "Float64", "ByteMultiArray", "Empty", "Time", "Bool")
    ),
    *(f"geometry_msgs/{name}" for name in ("PoseWithCovarianceStamped", "TwistStamped", "Polygon", "PoseArray")),
    *(f"sensor_msgs/{name}" for name in ("Imu", "Image", "LaserScan", "BatteryState", "JointState", "PointCloud2")),
    *(f"nav_msgs/{name}" for name in ("Odometry", "OccupancyGrid", "Path")),
    *(f"diagnostic_msgs/{name}" for name in ("DiagnosticArray", "KeyValue")),
    *("rosgraph_msgs/Log", "rosgraph_msgs/TopicStatistics"),
    "battery_uav_msgs/BatteryStatus",
]
ARRAY = re.compile(r"(.+)\[(\d*)\]")
INTEGERS = {"byte": (-(2**7), 2**7 - 1), "char": (0, 2**8 - 1)}
for bits in (8, 16, 32, 64):
    INTEGERS |= {f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1), f"uint{bits}": (0, 2**bits - 1)}


def messages(name: str) -> st.SearchStrategy[Any]:
    """Messages of a type, with any values in every field."""
    kind = lookup_installed(name)
    return st.builds(kind, **{field: values(of) for field, of in codec.types_of(kind).items()})


def values(kind: str) -> st.SearchStrategy[Any]:
    array = ARRAY.fullmatch(kind)
    if array:
        least, most = (int(array[2]), int(array[2])) if array[2] else (0, 3)
        if array[1] in ("uint8", "char"):
            return st.binary(min_size=least, max_size=most)
        return st.lists(values(array[1]), min_size=least, max_size=most)
    if kind in INTEGERS:
        low, high = INTEGERS[kind]
        return st.integers(low, high)
    if kind == "time":
        return st.builds(genpy.Time, st.integers(0, 2**32 - 1), st.integers(0, 10**9 - 1))
    if kind == "duration":
        return st.builds(genpy.Duration, st.integers(-(2**31), 2**31 - 1), st.integers(0, 10**9 - 1))
    simple = {
        "bool": st.booleans(),
        "float32": st.floats(width=32),
        "float64": st.floats(),
        "string": st.text(st.characters(exclude_categories=["Cs"]), max_size=8),
    }
    return simple[kind] if kind in simple else messages(kind)


def raw(message: Any) -> bytes:
    """The message as ROS carries it."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def sent(message: Any, fields: list[str] | None = None) -> Any:
    """The message as JSON has it on the other side of the wire, from what ROS carries."""
    kind = type(message)
    received = kind().deserialize(raw(message))
    return json.loads(dumps(codec.reader(kind, fields, lookup_installed)(received)))


@pytest.mark.parametrize("name", TYPES)
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_what_was_written_is_what_was_read(name: str, data: st.DataObject) -> None:
    message = data.draw(messages(name))
    written = codec.write(type(message)(), sent(message), lookup_installed)
    assert without_nan_bits(written) == without_nan_bits(message)


def without_nan_bits(message: Any) -> Any:
    """A message's values, with each NaN the same: JSON has one NaN."""
    if isinstance(message, genpy.Message):
        return {name: without_nan_bits(getattr(message, name)) for name in message.__slots__}
    if isinstance(message, (list, tuple)):
        return [without_nan_bits(value) for value in message]
    return "NaN" if isinstance(message, float) and math.isnan(message) else (str(message), type(message).__name__)


@pytest.mark.parametrize("name", TYPES)
def test_a_message_as_it_was_made_comes_back(name: str) -> None:
    kind = lookup_installed(name)
    assert raw(codec.write(kind(), sent(kind()), lookup_installed)) == raw(kind())


def test_json_carries_numbers_times_and_bytes_as_the_wire_has_them() -> None:
    colour = lookup_installed("std_msgs/ColorRGBA")(r=0.1, g=1 / 3, b=math.inf, a=math.nan)
    assert sent(colour) == {"r": 0.1, "g": 0.33333334, "b": "Infinity", "a": "NaN"}
    image = lookup_installed("sensor_msgs/Image")(data=bytes([0, 1, 255]))
    assert sent(image, ["data"]) == {"data": "AAH/"}
    assert sent(lookup_installed("std_msgs/UInt64")(data=2**64 - 1)) == {"data": 2**64 - 1}
    header = lookup_installed("std_msgs/Header")(stamp=genpy.Time(5, 7))
    assert sent(header, ["stamp"]) == {"stamp": {"sec": 5, "nanosec": 7}}
    assert sent(header, ["stamp.secs", "stamp.nsecs"]) == {"stamp": {"secs": 5, "nsecs": 7}}


def test_only_the_fields_that_are_asked_for_are_read() -> None:
    pose = lookup_installed("geometry_msgs/PoseWithCovarianceStamped")()
    pose.pose.pose.position.x, pose.header.frame_id = 1.5, "map"
    assert sent(pose, ["pose.pose.position.x", "header.frame_id"]) == {
        "pose": {"pose": {"position": {"x": 1.5}}},
        "header": {"frame_id": "map"},
    }
    assert sent(pose, ["nothing", "header.nothing", "nothing.at.all"]) == {"header": {}}
    assert sent(pose, []) == {}


@pytest.mark.parametrize(
    ("name", "data", "told"),
    [
        ("std_msgs/Int8", {"data": 200}, "data: 200 does not fit int8"),
        ("std_msgs/Int8", {"data": 1.5}, "data: 1.5 does not fit int8"),
        ("std_msgs/Int8", {"data": True}, "data: True does not fit int8"),
        ("std_msgs/String", {"data": 5}, "data: 5 does not fit string"),
        ("std_msgs/Bool", {"data": "yes"}, "data: 'yes' does not fit bool"),
        ("std_msgs/Float64", {"data": "much"}, "data: 'much' does not fit float64"),
        ("std_msgs/Float32", {"data": 1e300}, r"data: 1e\+300 does not fit float32"),
        ("std_msgs/Header", {"stamp": {"sec": 2**40}}, r"stamp\.sec: \d+ does not fit time"),
        ("std_msgs/Header", {"stamp": {"sec": -1}}, r"stamp: .* does not fit time"),
        ("std_msgs/Header", {"stamp": {"nano": 1}}, r"stamp\.nano: a time has no such field"),
        ("std_msgs/Header", {"stamp": 5}, "stamp: 5 does not fit time"),
        ("std_msgs/Header", {"stamps": 5}, "stamps: std_msgs/Header has no such field"),
        ("geometry_msgs/Polygon", {"points": [{"x": 1}, {"y": "b"}]}, r"points\[1\]\.y: 'b' does not fit float32"),
        ("geometry_msgs/Polygon", {"points": 3}, r"points: 3 does not fit geometry_msgs/Point32\[\]"),
        ("sensor_msgs/Image", {"data": "?"}, "data: '.' is not base64"),
        ("sensor_msgs/Imu", {"orientation_covariance": [1.0]}, r"orient.*: 1 items do not fit float64\[9\]"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_told_by_its_field(name: str, data: dict[str, Any], told: str) -> None:
    with pytest.raises(codec.CodecError, match=f"^{told}"):
        codec.write(lookup_installed(name)(), data, lookup_installed)


@pytest.mark.parametrize("name", ["nowhere/Nothing", "std_msgs/Nothing", "std_msgs", ""])
def test_a_type_that_is_not_there_is_told_by_its_name(name: str) -> None:
    assert installed_message(name) is None
    with pytest.raises(codec.CodecError, match=f"the type {name} can't be loaded"):
        lookup_installed(name)


@pytest.mark.parametrize("name", ["diagnostic_msgs/DiagnosticArray", "nav_msgs/Path", "sensor_msgs/Imu"])
def test_a_definition_that_a_publisher_sends_reads_as_the_installed_one(name: str) -> None:
    kind = lookup_installed(name)
    found = sent_definition({"type": name, "md5sum": kind._md5sum, "message_definition": kind._full_text})
    assert found.type is not kind
    message = next(iter(filled(name)))
    read = codec.reader(found.type, None, found.lookup)
    assert json.loads(dumps(read(found.type().deserialize(raw(message))))) == sent(message)


@pytest.mark.parametrize("fields", [["from", "pass", "self", "in.sec"], None])
def test_fields_that_are_words_of_pythons_are_read_and_written_by_their_names(fields: list[str] | None) -> None:
    text = "float64 from\nbool pass\nint32 self\ntime in\n"
    kind = genpy.dynamic.generate_dynamic("my_msgs/Move", text)["my_msgs/Move"]
    whole = {"from": 9.5, "pass": True, "self": 3, "in": {"sec": 2, "nanosec": 0}}
    message = codec.write(kind(), whole, lookup_installed)
    assert sent(message, fields) == (whole if fields is None else {**whole, "in": {"sec": 2}})
    assert codec.lacking(kind, ["from", "in.sec", "in.x", "global"], lookup_installed) == ["in.x", "global"]
    stamp = stamp_reader(kind, "in")
    assert stamp is not None
    assert stamp(message) == 2 * 10**9


def filled(name: str) -> list[Any]:
    """A message with one item in each of its sequences."""
    message = lookup_installed(name)()
    for field, kind in codec.types_of(type(message)).items():
        array = ARRAY.fullmatch(kind)
        if array and not array[2]:
            setattr(message, field, filled(array[1]))
    return [message]


@pytest.mark.parametrize("text", ["int32 data\n", "no definition\n", "", "other/Type data\n"])
def test_a_definition_that_is_not_of_the_messages_is_refused(text: str) -> None:
    header = {"type": "my_msgs/Odd", "md5sum": "1234", "message_definition": text, "callerid": "/odd"}
    with pytest.raises(codec.CodecError, match=r"^(my_msgs/Odd as /odd defines it|the definition of my_msgs/Odd)"):
        sent_definition(header)


def test_a_stamp_is_a_time_that_is_not_zero() -> None:
    header = lookup_installed("std_msgs/Header")
    stamped = lookup_installed("geometry_msgs/PointStamped")
    read = stamp_reader(stamped, None)
    assert read is not None
    assert read(stamped()) is None
    assert read(stamped(header=header(stamp=genpy.Time(1, 5)))) == 1_000_000_005
    assert stamp_reader(header, "frame_id") is None
    assert stamp_reader(lookup_installed("std_msgs/Int64"), None) is None


def test_a_number_that_a_spec_names_as_stamp_counts_as_seconds() -> None:
    whole, other = lookup_installed("std_msgs/Int64"), lookup_installed("std_msgs/Float64")
    for kind, number, time in (
        (whole, 5, 5 * 10**9),
        (whole, 0, None),
        (other, 1.5, 15 * 10**8),
        (other, math.nan, None),
    ):
        read = stamp_reader(kind, "data")
        assert read is not None
        assert read(kind(data=number)) == time
    assert stamp_reader(lookup_installed("std_msgs/Bool"), "data") is None


def test_paths_that_a_type_does_not_have_are_told() -> None:
    odometry = lookup_installed("nav_msgs/Odometry")
    there = ["header.stamp.sec", "header.stamp.secs", "header.seq", "twist.twist.linear.x", "pose.covariance"]
    lacking = ["twist.liner.x", "header.stamp.second", "pose.covariance.x", "child_frame_id.x", "nothing"]
    assert codec.lacking(odometry, [*there, *lacking], lookup_installed) == lacking
