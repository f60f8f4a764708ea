"""The shape of a message: its fields and what stands in them, as data; where it comes from is no matter here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

ValueKind = Literal["whole", "real", "bool", "text", "bytes"]
"""`whole` and `real` are numbers; a real one that is not finite arrives as text, and `bytes` as base64 text."""


@dataclass(frozen=True, slots=True)
class Value:
    """A field with one value; `type` is what the message's definition calls it, as `float32`.

    `may_be_list`: it is one on ROS 1, and which ROS it is of is not known. `unit`: it is from -1 to 1, as a part of a
    quaternion that turns things.
    """

    kind: ValueKind
    type: str
    may_be_list: bool = False
    unit: bool = False


@dataclass(frozen=True, slots=True)
class Many:
    """A field with a list; `length` is None where that depends on the message."""

    of: Shape
    length: int | None = None


@dataclass(frozen=True, slots=True)
class Record:
    """A message or a part of one; `name` is its type, as `geometry_msgs/msg/Twist`."""

    name: str
    fields: Mapping[str, Shape]


@dataclass(frozen=True, slots=True)
class Unknown:
    """A part of a message whose type, `name`, is not known here: anything may stand in it."""

    name: str


Shape = Value | Many | Record | Unknown

_BYTE = (-128, 255)  # signed on ROS 1, unsigned on ROS 2
WHOLE_NUMBERS: Mapping[str, tuple[int, int]] = {
    "byte": _BYTE, "char": _BYTE,
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}  # fmt: skip
"""The least and the largest number of each type of whole ones."""


UNIT: tuple[float, float] = (-1, 1)
"""The least and the largest number of a part of a quaternion."""
_NOT_FINITE = frozenset({"NaN", "Infinity", "-Infinity"})


def fits(shape: Value, value: object) -> bool:
    """Whether a value of JSON can stand in a field."""
    match shape.kind:
        case "bool":
            return isinstance(value, bool)
        case "text":
            return isinstance(value, str)
        case "bytes":
            return isinstance(value, str | list)
        case "whole":
            return is_number(value) and not isinstance(value, float)
        case "real":
            return value in _NOT_FINITE if isinstance(value, str) else is_number(value)


def is_number(value: object) -> bool:
    """Whether a value of JSON is a number; a Boolean is none."""
    return isinstance(value, int | float) and not isinstance(value, bool)
