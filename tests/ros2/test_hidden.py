"""Texts that go on behind a NUL, in real messages: rclpy reads them up to it."""

from __future__ import annotations

import importlib
import random
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
MARK = "a mark of its own"
_MANY = re.compile(r"sequence<(?P<of>.+?)(, (?P<most>\d+))?>|(?P<array>.+)\[(?P<size>\d+)\]")
_BITS = {"int8": -7, "int16": -15, "int32": -31, "int64": -63, "uint8": 8, "uint16": 16, "uint32": 32, "uint64": 64}


def hides(message_type: Any, serialized: bytes) -> bool:
    """Whether a text is found that goes on behind a NUL."""
    try:
        hidden.hidden_text_check(message_type)(serialized)
    except hidden.HiddenTextError:
        return True
    return False


class Maker:
    """Makes messages with random values, all texts of which are counted, and the one of a number is marked."""

    def __init__(self, seed: int, marked: int = -1) -> None:
        self._random, self._marked, self.texts = random.Random(seed), marked, 0

    def message(self, kind: str) -> Any:
        package, name = kind.split("/")
        made = getattr(importlib.import_module(f"{package}.msg"), name)()
        for field, inner in made.get_fields_and_field_types().items():
            setattr(made, field, self._value(inner))
        return made

    def _value(self, kind: str) -> Any:
        many = _MANY.fullmatch(kind)
        if many:
            size = int(many["size"]) if many["size"] else self._random.randint(0, int(many["most"] or 3))
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
                hidden.hidden_text_check(type(message))(serialized)
    assert 1 in read


@pytest.mark.parametrize("kind", ["geometry_msgs/Twist", "std_msgs/Empty", "test_msgs/BoundedPlainSequences"])
def test_a_type_without_texts_hides_nothing(kind: str) -> None:
    message = Maker(0).message(kind)
    assert not hides(type(message), serialization.serialize_message(message))


def test_a_text_in_the_feedback_of_an_action_is_looked_at() -> None:
    kind = pytest.importorskip("test_msgs.action").Fibonacci.Impl.FeedbackMessage
    assert not hides(kind, serialization.serialize_message(kind()))
