"""Messages of real types to JSON and back: nothing is lost, and what does not fit is told by its field."""

from __future__ import annotations

import array
import importlib
import json
import math
import random
import re
import string
from typing import Any

import pytest

pytest.importorskip("rclpy")
codec = pytest.importorskip("oracle_ros2.codec")
adapter = pytest.importorskip("oracle_adapter")
numpy = pytest.importorskip("numpy")

TYPES = [
    *(f"std_msgs/msg/{name}" for name in ("Header", "String", "ColorRGBA", "Int64MultiArray", "UInt8MultiArray")),
    *(f"std_msgs/msg/{name}" for name in ("Byte", "Char", "UInt64", "Float32", "Float64", "ByteMultiArray", "Empty")),
    *(f"geometry_msgs/msg/{name}" for name in ("PoseWithCovarianceStamped", "TwistStamped", "Polygon", "PoseArray")),
    *(f"sensor_msgs/msg/{name}" for name in ("Imu", "Image", "LaserScan", "BatteryState", "JointState", "PointCloud2")),
    *(f"diagnostic_msgs/msg/{name}" for name in ("DiagnosticArray", "KeyValue")),
    *(f"test_msgs/msg/{name}" for name in ("BasicTypes", "Arrays", "BoundedSequences", "UnboundedSequences")),
    *(f"test_msgs/msg/{name}" for name in ("Strings", "MultiNested", "Nested", "Constants", "Defaults")),
    "test_msgs/srv/BasicTypes_Request",
]
MANY = re.compile(r"sequence<(?P<of>.+?)(, (?P<most>\d+))?>|(?P<array>.+)\[(?P<size>\d+)\]")
FEW = 3  # items of a sequence, at most
LETTERS = string.printable + "äß漢字🤖\u2028\ud7ff"
INTEGER = re.compile(r"(u?)int(\d+)")


def type_of(name: str) -> Any:
    package, kind, short = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), short)


def fill(message: Any, chance: random.Random) -> Any:
    """Put random values into every field."""
    for name, kind in message.get_fields_and_field_types().items():
        many = MANY.fullmatch(kind)
        if many:
            setattr(message, name, items(many, getattr(message, name), chance))
        else:
            setattr(message, name, one(kind, chance))
    return message


def items(many: re.Match[str], current: Any, chance: random.Random) -> Any:
    size = int(many["size"]) if many["size"] else chance.randint(0, min(FEW, int(many["most"] or FEW)))
    values = [one(many["of"] or many["array"], chance) for _ in range(size)]
    if isinstance(current, array.array):
        return array.array(current.typecode, values)
    return numpy.array(values, dtype=current.dtype) if isinstance(current, numpy.ndarray) else values


def one(kind: str, chance: random.Random) -> Any:
    if "/" in kind:
        return fill(codec.load_type(kind)(), chance)
    if kind == "boolean":
        return chance.random() < 0.5
    if kind in ("octet", "byte"):
        return bytes([chance.randrange(256)])
    if kind == "char":
        return chance.randrange(256)
    if kind in ("float", "double"):
        return number(kind, chance)
    if kind.startswith(("string", "wstring")):
        most = re.search(r"\d+", kind)
        return "".join(chance.choice(LETTERS) for _ in range(chance.randint(0, int(most[0]) if most else 12)))
    return integer(kind, chance)


def number(kind: str, chance: random.Random) -> float:
    """Of any size; whatever has a 32-bit place is a 32-bit float."""
    value = chance.choice(
        [0.0, -0.0, 0.1, 1 / 3, 2.0**24 + 1, chance.uniform(-1e9, 1e9), 10 ** chance.uniform(-30, 30)]
    )
    return float(numpy.float32(value)) if kind == "float" else value


def integer(kind: str, chance: random.Random) -> int:
    parts = INTEGER.fullmatch(kind)
    assert parts, kind
    bits = int(parts[2])
    low, high = (0, 2**bits - 1) if parts[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return int(chance.choice([low, high, 0, chance.randint(low, high)]))


def sent(message: Any, fields: list[str] | None = None) -> Any:
    """The message as JSON has it on the other side of the wire."""
    return json.loads(adapter.dumps(codec.reader(type(message), fields)(message)))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("name", TYPES)
def test_what_was_written_is_what_was_read(name: str, seed: int) -> None:
    message = fill(type_of(name)(), random.Random(f"{name} {seed}"))
    assert codec.write(type(message)(), sent(message)) == message


@pytest.mark.parametrize("name", TYPES)
def test_a_message_as_it_was_made_comes_back(name: str) -> None:
    message = type_of(name)()
    assert codec.write(type(message)(), sent(message)) == message


def test_json_carries_numbers_and_bytes_as_the_wire_has_them() -> None:
    colour = codec.load_type("std_msgs/msg/ColorRGBA")(r=0.1, g=1 / 3, b=math.inf, a=math.nan)
    assert sent(colour) == {"r": 0.1, "g": 0.33333334, "b": "Infinity", "a": "NaN"}
    image = codec.load_type("sensor_msgs/msg/Image")(data=[0, 1, 255])
    assert sent(image, ["data"]) == {"data": "AAH/"}
    large = codec.load_type("std_msgs/msg/UInt64")(data=2**64 - 1)
    assert sent(large) == {"data": 2**64 - 1}
    octets = codec.load_type("std_msgs/msg/ByteMultiArray")(data=[b"\0", b"\xff"])
    assert sent(octets, ["data"]) == {"data": "AP8="}
    assert sent(codec.load_type("std_msgs/msg/Byte")(data=b"\x80")) == {"data": 128}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["std_msgs/msg/Float32", "std_msgs/msg/Float64"])
def test_what_is_no_finite_number_comes_back(name: str, value: float) -> None:
    message = codec.write(type_of(name)(), sent(type_of(name)(data=value)))
    assert repr(message.data) == repr(value)


def test_only_the_fields_that_are_asked_for_are_read() -> None:
    pose = fill(type_of("geometry_msgs/msg/PoseWithCovarianceStamped")(), random.Random(1))
    position = pose.pose.pose.position
    assert sent(pose, ["pose.pose.position.x", "header.frame_id"]) == {
        "pose": {"pose": {"position": {"x": position.x}}},
        "header": {"frame_id": pose.header.frame_id},
    }
    assert sent(pose, ["pose.pose.position", "pose.pose.position.x"])["pose"]["pose"]["position"] == sent(position)
    assert sent(pose, ["pose.pose.position.x", "pose.pose.position"])["pose"]["pose"]["position"] == sent(position)
    assert sent(pose, ["nothing", "header.nothing", "nothing.at.all"]) == {"header": {}}
    assert sent(pose, []) == {}


def test_a_path_through_a_sequence_reads_its_items() -> None:
    status = codec.load_type("diagnostic_msgs/msg/DiagnosticStatus")
    message = codec.load_type("diagnostic_msgs/msg/DiagnosticArray")(status=[status(name="a"), status(name="b")])
    assert [item["name"] for item in sent(message, ["status.name"])["status"]] == ["a", "b"]


@pytest.mark.parametrize(
    ("name", "data", "told"),
    [
        ("std_msgs/msg/Int8", {"data": 200}, "data: 200 does not fit int8"),
        ("std_msgs/msg/Int8", {"data": 1.5}, "data: 1.5 does not fit int8"),
        ("std_msgs/msg/Int8", {"data": None}, "data: None does not fit int8"),
        ("std_msgs/msg/String", {"data": 5}, "data: 5 does not fit string"),
        ("std_msgs/msg/Bool", {"data": "yes"}, "data: 'yes' does not fit boolean"),
        ("std_msgs/msg/Float64", {"data": "much"}, "data: 'much' does not fit double"),
        ("std_msgs/msg/Byte", {"data": 256}, "data: 256 does not fit octet"),
        ("std_msgs/msg/Float32", {"data": 1e300}, r"data: 1e\+300 does not fit float"),
        ("std_msgs/msg/Header", {"stamp": {"sec": 2**40}}, r"stamp\.sec: \d+ does not fit int32"),
        ("std_msgs/msg/Header", {"stamp": {"nano": 1}}, r"stamp\.nano: Time has no such field"),
        ("std_msgs/msg/Header", {"stamp": 5}, "stamp: 5 does not fit Time"),
        ("std_msgs/msg/Header", {"stamps": 5}, "stamps: Header has no such field"),
        ("geometry_msgs/msg/Polygon", {"points": [{"x": 1}, {"y": "b"}]}, r"points\[1\]\.y: 'b' does not fit float"),
        ("geometry_msgs/msg/Polygon", {"points": 3}, "points: 3 does not fit sequence<geometry_msgs/Point32>"),
        ("sensor_msgs/msg/Image", {"data": "?"}, "data: '.' does not fit sequence<uint8>"),
        ("test_msgs/msg/Arrays", {"bool_values": [True]}, r"bool_values: \[True\] does not fit boolean\[3\]"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_told_by_its_field(name: str, data: dict[str, Any], told: str) -> None:
    with pytest.raises(codec.CodecError, match=f"^{told}"):
        codec.write(type_of(name)(), data)


@pytest.mark.parametrize("name", ["nowhere/msg/Nothing", "std_msgs/msg/Nothing", "std_msgs/srv/String", "std_msgs", ""])
def test_a_type_that_is_not_there_is_told_by_its_name(name: str) -> None:
    with pytest.raises(codec.CodecError, match=f"the type {name} can't be loaded"):
        codec.load_type(name)
