"""Messages of real types to JSON and back: nothing is lost, and what does not fit is told by its field."""

from __future__ import annotations

import array
import importlib
import json
import math
import random
import re
import string
import struct
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rclpy")
numpy = pytest.importorskip("numpy")
codec = pytest.importorskip("oracle_ros2.codec")
adapter = pytest.importorskip("oracle_adapter")
serialization = pytest.importorskip("rclpy.serialization")
singles = pytest.importorskip("oracle_ros2.singles")
stamps = pytest.importorskip("oracle_ros2.stamps")

# rclpy imports an old lark with its first message, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

PACKAGES = (
    "diagnostic_msgs", "geometry_msgs", "nav_msgs", "sensor_msgs", "std_msgs", "std_srvs", "test_msgs",
    "trajectory_msgs",
)  # fmt: skip
MANY = re.compile(r"sequence<(?P<of>.+?)(, (?P<most>\d+))?>|(?P<array>.+)\[(?P<size>\d+)\]")
FEW = 3  # items of a sequence, at most
LETTERS = string.printable + "äß漢字🤖\u2028\ud7ff\ufffd"
INTEGER = re.compile(r"(u?)int(\d+)")


def types() -> Iterator[str]:
    """Every message, request and response of the packages."""
    for package in PACKAGES:
        for kind in ("msg", "srv"):
            try:
                module = importlib.import_module(f"{package}.{kind}")
            except ImportError:
                continue  # a package may have messages only, or services only
            for name, found in sorted(vars(module).items()):
                if kind == "msg" and hasattr(found, "get_fields_and_field_types"):
                    yield f"{package}/{kind}/{name}"
                elif hasattr(found, "Request"):
                    yield from (f"{package}/{kind}/{name}_Request", f"{package}/{kind}/{name}_Response")


TYPES = list(types())


def type_of(name: str) -> Any:
    package, kind, short = name.split("/")
    module = importlib.import_module(f"{package}.{kind}")
    if kind == "srv":
        service, _, side = short.rpartition("_")
        return getattr(getattr(module, service), side)
    return getattr(module, short)


class Draw:
    """Random values of any kind; those at the limits are as likely as all others together."""

    def __init__(self, seed: str) -> None:
        self._chance = random.Random(seed)

    def message(self, message: Any) -> Any:
        """The message, with a value in every field."""
        for name, kind in message.get_fields_and_field_types().items():
            setattr(message, name, self.value(kind))
        return message

    def value(self, kind: str) -> Any:
        many = MANY.fullmatch(kind)
        if not many:
            return self._one(kind)
        size = int(many["size"]) if many["size"] else self._chance.randint(0, min(FEW, int(many["most"] or FEW)))
        return [self._one(many["of"] or many["array"]) for _ in range(size)]

    def _one(self, kind: str) -> Any:
        if "/" in kind:
            return self.message(codec.load_type(kind)())
        if kind == "boolean":
            return self._chance.random() < 0.5
        if kind in ("octet", "byte"):
            return self._chance.randbytes(1)
        if kind in ("float", "double"):
            return self._number(kind)
        if kind.startswith(("string", "wstring")):
            most = re.search(r"\d+", kind)
            return "".join(self._chance.choices(LETTERS, k=self._chance.randint(0, int(most[0]) if most else 12)))
        parts = INTEGER.fullmatch(kind)
        assert parts, kind
        bits = int(parts[2])
        low, high = (0, 2**bits - 1) if parts[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return self._chance.choice([low, high, 0, *(self._chance.randint(low, high) for _ in range(3))])

    def _number(self, kind: str) -> float:
        """Of any size, and none; any bits are a number of that kind."""
        size = "<f" if kind == "float" else "<d"
        (bits,) = struct.unpack(size, self._chance.randbytes(struct.calcsize(size)))
        value = self._chance.choice([0.0, -0.0, 0.1, math.inf, -math.inf, math.nan, bits, bits, bits])
        # a 32-bit place holds a 32-bit number, and one NaN is as good as another
        return math.nan if math.isnan(value) else struct.unpack(size, struct.pack(size, value))[0]


def on_the_wire(message: Any) -> str:
    """The message as it arrives where ROS sends it; in words, since NaN is not equal to itself."""
    return repr(serialization.deserialize_message(serialization.serialize_message(message), type(message)))


def sent(message: Any, fields: list[str] | None = None) -> Any:
    """The message as JSON has it on the other side of the wire."""
    return json.loads(adapter.dumps(codec.reader(type(message), fields)(message)))


@pytest.mark.parametrize("name", TYPES)
def test_what_was_written_is_what_was_read(name: str) -> None:
    for seed in range(5):
        message = Draw(f"{name} {seed}").message(type_of(name)())
        assert on_the_wire(codec.write(type(message)(), sent(message))) == on_the_wire(message), seed


@pytest.mark.parametrize("width", [32, 64])
@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_any_number_comes_back(width: int, data: st.DataObject) -> None:
    kind = type_of(f"std_msgs/msg/Float{width}")
    number = data.draw(st.floats(width=width, allow_nan=False))
    assert repr(codec.write(kind(), sent(kind(data=number))).data) == repr(number)


POWERS = [2.0**power for power in range(-149, 128)]


@pytest.mark.parametrize("name", ["sequence", "array"])
def test_a_long_list_of_32_bit_numbers_has_those_that_one_by_one_have(name: str) -> None:
    chance = random.Random(name)
    near = [struct.unpack("<I", struct.pack("<f", power))[0] + step for power in POWERS for step in range(-3, 4)]
    bits = [*(chance.getrandbits(32) for _ in range(20_000)), *(number for number in near if number >= 0)]
    numbers = [struct.unpack("<f", struct.pack("<I", one))[0] for one in bits]
    numbers += [chance.uniform(-30, 30) for _ in range(20_000)] + [number / 1000 for number in range(2000)]
    values = array.array("f", numbers) if name == "sequence" else numpy.array(numbers).astype(numpy.float32)
    found = singles.all_shortest(values)
    assert list(map(repr, found)) == [repr(singles.shortest(value)) for value in values]


@settings(max_examples=300, deadline=None)
@given(text=st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0")))
def test_any_text_comes_back(text: str) -> None:
    for kind, field in (("std_msgs/msg/String", "data"), ("test_msgs/msg/WStrings", "wstring_value")):
        message = type_of(kind)(**{field: text})
        assert on_the_wire(codec.write(type_of(kind)(), sent(message))) == on_the_wire(message)


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
    pose = type_of("geometry_msgs/msg/PoseWithCovarianceStamped")()
    pose.header.frame_id = "map"
    position = pose.pose.pose.position
    position.x, position.y = 0.1, -2.5
    assert sent(pose, ["pose.pose.position.x", "header.frame_id"]) == {
        "pose": {"pose": {"position": {"x": position.x}}},
        "header": {"frame_id": pose.header.frame_id},
    }
    assert sent(pose, ["pose.pose.position", "pose.pose.position.x"])["pose"]["pose"]["position"] == sent(position)
    assert sent(pose, ["pose.pose.position.x", "pose.pose.position"])["pose"]["pose"]["position"] == sent(position)
    assert sent(pose, ["nothing", "header.nothing", "nothing.at.all"]) == {"header": {}}
    assert sent(pose, []) == {}


def test_an_unread_image_is_not_touched() -> None:
    class Untouchable:
        header = type_of("std_msgs/msg/Header")(frame_id="front")

        @property
        def data(self) -> None:
            pytest.fail("the image was read")

    read = codec.reader(type_of("sensor_msgs/msg/Image"), ["header.frame_id"])
    assert read(Untouchable()) == {"header": {"frame_id": "front"}}


def test_a_list_that_no_frame_holds_is_not_converted() -> None:
    class Cells:
        def __len__(self) -> int:
            return 501

        def tolist(self) -> None:
            pytest.fail("the map was read")

    read = codec.reader(type_of("nav_msgs/msg/OccupancyGrid"), ["data"], 1000)
    assert len(adapter.dumps(read(SimpleNamespace(data=Cells())))) > 1000


@pytest.mark.parametrize("name", ["UInt8MultiArray", "ByteMultiArray", "Int8MultiArray", "Float32MultiArray"])
def test_a_list_is_read_as_it_is_where_a_frame_may_hold_it(name: str) -> None:
    kind, most = type_of(f"std_msgs/msg/{name}"), 300
    whole, bounded = codec.reader(kind, ["data"]), codec.reader(kind, ["data"], most)
    one = b"\0" if name.startswith("Byte") else 0
    converted = 0
    for count in range(most):
        message = kind(data=[one] * count)
        texts = [adapter.dumps(read(message)) for read in (whole, bounded)]
        assert texts[0] == texts[1] or min(map(len, texts)) > most
        converted += texts[0] == texts[1]
    assert converted >= most // 4


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
        ("std_msgs/msg/Int8", {"data": True}, "data: True does not fit int8"),
        ("std_msgs/msg/UInt64", {"data": 2**64}, r"data: \d+ does not fit uint64"),
        ("std_msgs/msg/Float64", {"data": True}, "data: True does not fit double"),
        ("std_msgs/msg/Float64", {"data": "1.5"}, "data: '1.5' does not fit double"),
        ("std_msgs/msg/Float64", {"data": None}, "data: None does not fit double"),
        ("std_msgs/msg/Byte", {"data": "a"}, "data: 'a' does not fit octet"),
        ("std_msgs/msg/Byte", {"data": True}, "data: True does not fit octet"),
        ("test_msgs/msg/UnboundedSequences", {"string_values": "abc"}, "string_values: .abc. does not fit sequence"),
        ("test_msgs/msg/UnboundedSequences", {"string_values": {"a": 1}}, r"string_values: \{'a': 1\} does not fit"),
        ("test_msgs/msg/UnboundedSequences", {"string_values": ["a", 1]}, r"string_values\[1\]: 1 does not fit string"),
        ("test_msgs/msg/UnboundedSequences", {"int8_values": [1, 200]}, r"int8_values: \[1, 200\] does not fit"),
        ("test_msgs/msg/BoundedSequences", {"int8_values": [1] * 4}, r"int8_values: \[1, 1, 1, 1\] does not fit"),
        ("test_msgs/msg/Arrays", {"uint8_values": "AAA="}, "uint8_values: 'AAA=' does not fit uint8"),
        ("sensor_msgs/msg/Image", {"data": [1, 256]}, r"data: \[1, 256\] does not fit sequence<uint8>"),
        ("test_msgs/msg/MultiNested", {"array_of_arrays": [{"bool_values": 1}]}, r".*\[0\]\.bool_values: 1"),
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


def test_a_number_that_a_spec_names_as_stamp_counts_as_seconds() -> None:
    whole, other = type_of("std_msgs/msg/Int64"), type_of("std_msgs/msg/Float64")
    for kind, number, time in (
        (whole, 5, 5 * 10**9),
        (whole, 0, None),
        (other, 1.5, 15 * 10**8),
        (other, math.nan, None),
    ):
        read = stamps.stamp_reader(kind, "data")
        assert read is not None
        assert read(kind(data=number)) == time
    assert stamps.stamp_reader(type_of("std_msgs/msg/Bool"), "data") is None
    assert stamps.stamp_reader(whole, None) is None


@pytest.mark.parametrize(("sec", "nanosec", "time"), [(5, 7, 5 * 10**9 + 7), (0, 0, None), (-1, 5, None)])
def test_a_stamp_before_the_epoch_is_none(sec: int, nanosec: int, time: int | None) -> None:
    """No event may have such a one: the message is ordered as if it had none."""
    header = type_of("std_msgs/msg/Header")
    read = stamps.stamp_reader(header, None)
    assert read is not None
    message = header()
    message.stamp.sec, message.stamp.nanosec = sec, nanosec
    assert read(message) == time


def test_paths_that_a_type_does_not_have_are_told() -> None:
    odometry = codec.load_type("nav_msgs/msg/Odometry")
    there = ["header.stamp.sec", "twist.twist.linear.x", "pose.covariance", "child_frame_id"]
    lacking = ["twist.liner.x", "header.stamp.secs", "pose.covariance.x", "child_frame_id.x", "nothing"]
    assert codec.lacking(odometry, [*there, *lacking]) == lacking


def test_a_package_whose_python_can_t_be_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """rosidl writes `self.from = …` for a field of that name, which C++ takes."""
    module = tmp_path / "unreadable_msgs" / "msg" / "__init__.py"
    module.parent.mkdir(parents=True)
    module.write_text("class Route:\n    def __init__(self):\n        self.from = 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(codec.CodecError, match=r"the type unreadable_msgs/msg/Route can't be loaded.*invalid syntax"):
        codec.load_type("unreadable_msgs/msg/Route")


def test_a_package_whose_libraries_are_not_found_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = tmp_path / "bare_msgs" / "msg" / "__init__.py"
    module.parent.mkdir(parents=True)
    module.write_text(
        """from rosidl_generator_py import import_type_support


class Kind(type):
    _TYPE_SUPPORT = None

    @classmethod
    def __import_type_support__(cls):
        import_type_support("bare_msgs")


class Route(metaclass=Kind):
    pass
"""
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(codec.CodecError, match=r"bare_msgs/msg/Route can't be loaded.*rosidl_typesupport_c"):
        codec.load_type("bare_msgs/msg/Route")
