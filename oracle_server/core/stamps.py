"""Publication times inside messages."""

from __future__ import annotations

from collections.abc import Mapping

from oracle_server.core.expressions import read

DEFAULT_PATHS = ("header.stamp", "stamp")
_SECOND = 10**9
_LARGEST = 2**63


def stamp_in(message: object, path: str | None) -> int | None:
    """The publication time that stands in a message, in nanoseconds since the epoch.

    `path` is dotted, None for the default places. ROS 1 and ROS 2 times are read, and numbers as seconds. None where
    there is none; zero counts as none.
    """
    for place in (path,) if path else DEFAULT_PATHS:
        stamp = nanoseconds(read(message, tuple(place.split("."))))
        if stamp:
            return stamp
    return None


def nanoseconds(value: object) -> int | None:
    """A ROS time (`{sec, nanosec}`, `{secs, nsecs}`) or a number of seconds in nanoseconds, None for anything else."""
    if isinstance(value, Mapping):
        for whole, part in (("sec", "nanosec"), ("secs", "nsecs")):
            seconds, rest = value.get(whole), value.get(part)
            if type(seconds) is int and type(rest) is int:
                return _within(seconds * _SECOND + rest)
        return None
    if type(value) is int:
        return _within(value * _SECOND)
    if type(value) is float and abs(value) < _LARGEST:
        return _within(round(value * _SECOND))
    return None


def _within(stamp: int) -> int | None:
    return stamp if 0 < stamp < _LARGEST else None
