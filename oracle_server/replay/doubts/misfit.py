"""Whether a recorded message can be of the type that the spec says: logs in JSON do not say what type they have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import NoneType
from typing import Any

from oracle_server.core.expression import told
from oracle_server.core.shapes import Many, Record, Shape, Unknown, Value, fits, is_number

TIMES = frozenset({"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"})
"""Types that logs also have as a number, or with the names of ROS 1."""
_STAND_INS = frozenset({"structure_needs_at_least_one_member"})
"""The field of a type without fields, as ROS 2 has it."""
_MOST = 6
"""Fields of a message that are named."""


_SURE: Mapping[str, frozenset[type]] = {
    "bool": frozenset({bool, NoneType}),
    "text": frozenset({str, NoneType}),
    "bytes": frozenset({str, list, NoneType}),
    "whole": frozenset({int, NoneType}),
    "real": frozenset({float, int, NoneType}),
}
"""The types of values that are of a kind, whatever they are."""


def quick(shape: Shape) -> Callable[[Any], bool]:
    """A fast look: true where `misfit` is sure to find nothing, and false where it may."""
    match shape:
        case Value():
            sure = _SURE[shape.kind]
            return lambda value: type(value) in sure
        case Many():
            of = quick(shape.of)
            return lambda value: type(value) is list and (not value or of(value[0]))
        case Record():
            fields = {name: quick(inner) for name, inner in shape.fields.items()}
            return lambda value: _quick_in_record(fields, value)
        case Unknown():
            return lambda _: True


def _quick_in_record(fields: Mapping[str, Callable[[Any], bool]], value: Any) -> bool:
    if type(value) is not dict:
        return False
    known = not value
    for name, inner in value.items():
        check = fields.get(name)
        if check is not None:
            if not check(inner):
                return False
            known = True
    return known


def misfit(shape: Shape, value: object, path: str = "") -> str:
    """Why a value can't be of a shape, in a few words; empty where it can.

    A missing field is none, nor is one that the type does not have beside others that it has: logs keep what is
    read, and may add to it. Of a list the first item is looked at.
    """
    if value is None or (isinstance(shape, Record) and shape.name in TIMES and is_number(value)):
        return ""
    match shape:
        case Unknown():
            return ""
        case Record() if isinstance(value, Mapping):
            return _in_record(shape, value, path)
        case Many() if isinstance(value, list):
            return misfit(shape.of, value[0], f"{path}[0]") if value else ""
        case Value() if fits(shape, value) or (shape.kind == "whole" and _whole(value)):
            return ""
    return f"`{path}` is {told(value)}, where the type has {_described(shape)}"


def _in_record(shape: Record, value: Mapping[str, object], path: str) -> str:
    known = [name for name in value if name in shape.fields]
    if value and not known and shape.fields.keys() - _STAND_INS:
        subject = f"`{path}`" if path else "it"
        return f"{subject} has {_listed(value)}, and {shape.name} has {_listed(shape.fields)}"
    inner = (misfit(shape.fields[name], value[name], f"{path}.{name}" if path else name) for name in known)
    return next(filter(None, inner), "")


def _whole(value: object) -> bool:
    """Whether it is a whole number in JSON of other programs, which may write `3.0`."""
    return isinstance(value, float) and value.is_integer()


def _described(shape: Shape) -> str:
    if isinstance(shape, Many):
        return "a list"
    name = shape.type if isinstance(shape, Value) else shape.name
    return f"{'an' if name.startswith('int') else 'a'} {name}"


def _listed(names: Iterable[str]) -> str:
    found = sorted(names)
    if len(found) > _MOST:
        return f"{', '.join(found[:_MOST])} and {len(found) - _MOST} more"
    return " and ".join(filter(None, (", ".join(found[:-1]), found[-1])))
