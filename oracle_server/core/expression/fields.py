"""Fields and elements: of the message, of variables, of lists.

A field that is missing, or asked of null, is absent; one that is asked of what has no fields has failed. A time that is
read whole, as in a list, comes under ROS 2's names; those of ROS 1 stand for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oracle_server.core.expression.cost import Frame, charge
from oracle_server.core.expression.loops import Run
from oracle_server.core.expression.stops import Absent, Failed, Stopped
from oracle_server.core.expression.values import unfit

_TIME = {"sec", "nanosec"}
_RENAMED = {"secs": "sec", "nsecs": "nanosec"}
"""What ROS 1 calls the parts of a time."""


def alone(name: str) -> Run:
    """A field of the message that is the whole expression: null where it is missing, which is as absent."""
    return lambda message, _: message.get(name)


def path(names: tuple[str, ...]) -> Run:
    """A field of the message."""
    if not names:
        return lambda message, _: message
    if len(names) > 1:
        return _deep(names)
    (name,) = names

    def top(message: Mapping[str, Any], _: Frame) -> Any:
        try:
            return message[name]
        except KeyError:
            raise Absent from None

    return top


def _deep(names: tuple[str, ...]) -> Run:
    def deep(message: Any, _: Frame) -> Any:
        for name in names:
            try:
                message = message[name]
            except (KeyError, TypeError):
                message = _otherwise(message, name)
        return message

    return deep


def field(of: Run, name: str) -> Run:
    """A field of something else."""

    def run(message: Mapping[str, Any], frame: Frame) -> Any:
        whole = of(message, frame)
        try:
            return whole[name]
        except (KeyError, TypeError):
            return _otherwise(whole, name)

    return run


def has_path(names: tuple[str, ...]) -> Run:
    """Whether a field of the message is there."""
    return has_field(path(names[:-1]), names[-1])


def has_field(of: Run, name: str) -> Run:
    """Whether a field of something is there."""

    def run(message: Mapping[str, Any], frame: Frame) -> bool:
        whole = of(message, frame)
        if isinstance(whole, Mapping):
            return name in whole or _is_renamed(whole, name)
        raise _without(whole)

    return run


def element(of: Run, index: Run) -> Run:
    """An element of a list by its number from 0, or a field by a name that is computed."""

    def run(message: Mapping[str, Any], frame: Frame) -> Any:
        whole, at = of(message, frame), index(message, frame)
        if type(whole) is list and type(at) is int:
            if 0 <= at < len(whole):
                return whole[at]
            raise Failed("it has no such element", whole, at)
        if type(whole) is dict and type(at) is str:
            charge(frame, len(at) >> 6)
            if at in whole:
                return whole[at]
            raise Absent
        raise _no_element(whole, at)

    return run


def has_element(of: Run, index: Run) -> Run:
    """Whether a list has an element of a number, or something a field of a computed name."""

    def run(message: Mapping[str, Any], frame: Frame) -> bool:
        whole, at = of(message, frame), index(message, frame)
        if type(whole) is list and type(at) is int:
            return 0 <= at < len(whole)
        if type(whole) is dict and type(at) is str:
            charge(frame, len(at) >> 6)
            return at in whole
        raise _no_element(whole, at)

    return run


def _is_renamed(whole: Mapping[str, Any], name: str) -> bool:
    return name in _RENAMED and whole.keys() == _TIME


def _otherwise(whole: Any, name: str) -> Any:
    """A field that is not there under its name."""
    if isinstance(whole, Mapping) and _is_renamed(whole, name):
        return whole[_RENAMED[name]]
    raise _without(whole) from None


def _without(whole: Any) -> Stopped:
    return Absent() if whole is None or isinstance(whole, Mapping) else Failed("it has no fields", whole)


def _no_element(whole: Any, at: Any) -> Absent | Failed:
    """What ends the evaluation of an index that does not fit, as of bytes, which arrive as a text."""
    why = "an index takes a list and a whole number"
    if type(whole) is str:
        why += "; uint8[] arrives as a text in base64, of which all is compared, as in msg.data == 'AQID'"
    return unfit(why, whole, at)
