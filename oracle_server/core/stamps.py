"""Publication times inside messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from oracle_server.core.expression import read, told
from oracle_server.core.formula.tree import NANOSECONDS

Unit = Literal["ns", "us", "ms", "s"]
Epoch = Literal["unix", "boot"]
DEFAULT_PATHS = ("header.stamp", "stamp")
_LARGEST = 2**63


@dataclass(frozen=True, slots=True)
class Stamp:
    """The field of a message's publication time, as a dotted path; the unit of a number there, None for seconds.

    `epoch` is what it counts from: 1970, or the start of the robot.
    """

    field: str
    unit: Unit | None = None
    epoch: Epoch = "unix"

    @property
    def plain(self) -> bool:
        """Whether adapters can read it: a time, or seconds since 1970. Others are read by the server."""
        return self.unit in (None, "s") and self.epoch == "unix"


def stamp_in(message: object, stamp: Stamp | None) -> int | None:
    """The publication time that stands in a message, in nanoseconds since 1970.

    `stamp` is where, None for the default places. ROS 1 and ROS 2 times are read, and numbers. None where there is
    none, and where it counts from the robot's start; zero counts as none.
    """
    if stamp is not None:
        return _at(message, stamp.field, stamp.unit) if stamp.epoch == "unix" else None
    for place in DEFAULT_PATHS:
        found = _at(message, place, None)
        if found:
            return found
    return None


def stamp_fault(message: object, stamp: Stamp | None) -> str:
    """Why a message has no publication time though something stands in its place; empty where nothing is wrong.

    Zero counts as nothing, and so does what is missing, but for a field that the spec names.
    """
    for place in DEFAULT_PATHS if stamp is None else (stamp.field,):
        value = read(message, tuple(place.split(".")))
        if value is None and stamp is not None:
            return f"it has no `{place}`"
        if nanoseconds(value, stamp.unit if stamp else None) is not None:
            return ""
        if value is not None and not _is_zero(value):
            return f"`{place}` is {_told(value)}, and no time"
    return ""


def since_boot_in(message: object, stamp: Stamp) -> int | None:
    """How long after the robot's start a message was published, in nanoseconds; None where that is not told."""
    return _at(message, stamp.field, stamp.unit)


def nanoseconds(value: object, unit: Unit | None = None) -> int | None:
    """A ROS time (`{sec, nanosec}`, `{secs, nsecs}`) or a number in nanoseconds, None for anything else.

    `unit` is that of numbers, None for seconds.
    """
    if isinstance(value, Mapping):
        for whole, part in (("sec", "nanosec"), ("secs", "nsecs")):
            seconds, rest = value.get(whole), value.get(part)
            if type(seconds) is int and type(rest) is int:
                return _within(seconds * NANOSECONDS["s"] + rest)
        return None
    if type(value) is int:
        return _within(value * NANOSECONDS[unit or "s"])
    if type(value) is float and abs(value) < _LARGEST:
        return _within(round(value * NANOSECONDS[unit or "s"]))
    return None


def _at(message: object, path: str, unit: Unit | None) -> int | None:
    return nanoseconds(read(message, tuple(path.split("."))), unit)


def _is_zero(value: object) -> bool:
    parts = value.values() if isinstance(value, Mapping) else (value,)
    return all(type(part) in (int, float) and part == 0 for part in parts)


def _told(value: object) -> str:
    if isinstance(value, Mapping):
        return " and ".join(f"{key} {told(part)}" for key, part in value.items()) or "empty"
    return told(value)


def _within(stamp: int) -> int | None:
    return stamp if 0 < stamp < _LARGEST else None
