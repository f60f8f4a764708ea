"""ROS 2 messages to plain data for JSON, and plain data to messages.

Only the fields that are asked for are read. Numbers keep their value, a 32-bit float as its shortest decimal; uint8
sequences become bytes, which JSON carries as base64; every other sequence becomes a list.
"""

from __future__ import annotations

import base64
import importlib
import re
import struct
from functools import lru_cache
from typing import Any, Callable, Iterable, Mapping, Sequence

from oracle_adapter.fields import grouped
from rclpy.type_support import check_for_type_support

from oracle_ros2.singles import all_shortest, shortest

Read = Callable[[Any], Any]

SEQUENCE = re.compile(r"sequence<(?P<of>.+?)(, \d+)?>|(?P<array>.+)\[(?P<size>\d+)\]")
_NO_NUMBERS = frozenset({"NaN", "Infinity", "-Infinity"})
_BYTES = frozenset({"uint8", "octet", "byte"})
_HALVES = ("_Request", "_Response")


class CodecError(Exception):
    """Data that does not fit a message type; the text names the field."""


def load_type(name: str) -> Any:
    """The class of `pkg/msg/Type` or `pkg/srv/Type`; raises `CodecError` where it is not there or not whole.

    Fields name their types as `pkg/Type`, which may also be half of a service: events of its calls hold these.
    """
    package, _, rest = name.partition("/")
    kind, _, type_name = rest.rpartition("/")
    if not kind:
        kind = "srv" if type_name.endswith(_HALVES) else "msg"
    try:
        found = getattr(importlib.import_module(f"{package}.{kind}"), type_name)
        check_for_type_support(found)
    except Exception as error:  # whatever its package does: fields named as words of Python's make it no Python
        raise CodecError(f"the type {name} can't be loaded; is its package built and sourced? ({error})") from error
    return found


def reader(message_type: Any, fields: Iterable[str] | None, most: int | None = None) -> Read:
    """A function from messages to plain data with these dotted fields; None means all of them.

    Fields that the type does not have are left out. A list that takes more than `most` bytes as JSON is as many blanks,
    which no frame holds either: a map of 16 million cells would hold up everything else for seconds.
    """
    if fields is None:
        return _whole(message_type, most)
    types = message_type.get_fields_and_field_types()
    wanted = {name: inner for name, inner in grouped(fields).items() if name in types}
    parts = [(name, _value_reader(types[name], inner, most)) for name, inner in wanted.items()]
    return lambda message: {name: read(getattr(message, name)) for name, read in parts}


def lacking(message_type: Any, paths: Iterable[str]) -> list[str]:
    """Those of some dotted paths at which the type has nothing."""
    return [path for path in paths if not _has(message_type, path.split("."))]


def _has(message_type: Any, names: Sequence[str]) -> bool:
    kind = message_type.get_fields_and_field_types().get(names[0])
    if kind is None or len(names) == 1:
        return kind is not None
    return "/" in kind and not SEQUENCE.fullmatch(kind) and _has(load_type(kind), names[1:])


@lru_cache(maxsize=None)
def _whole(message_type: Any, most: int | None) -> Read:
    types = message_type.get_fields_and_field_types()
    parts = [(name, _value_reader(kind, None, most)) for name, kind in types.items()]
    return lambda message: {name: read(getattr(message, name)) for name, read in parts}


def _value_reader(kind: str, inner: list[str] | None, most: int | None) -> Read:
    many = SEQUENCE.fullmatch(kind)
    if many:
        item = many["of"] or many["array"]
        read = _sequence_reader(item, most)
        return read if most is None else _bounded(read, least(item), most)
    if "/" in kind:
        return reader(load_type(kind), inner, most)
    if kind == "float":
        return shortest
    if kind in ("octet", "byte"):
        return lambda value: value[0] if isinstance(value, bytes) else value
    return lambda value: value


@lru_cache(maxsize=None)
def least(item: str) -> float:
    """How many bytes as JSON an item of a list takes at least, by its kind."""
    return 4 / 3 if item in _BYTES else _least(item) + 1  # and a comma


def _least(kind: str) -> int:
    many = SEQUENCE.fullmatch(kind)
    if many:
        return 2 + int(int(many["size"] or 0) * least(many["of"] or many["array"]))
    if "/" not in kind:
        return 1
    fields = load_type(kind).get_fields_and_field_types()
    return 2 + sum(len(f'"{name}":,') + _least(inner) for name, inner in fields.items())


def _bounded(read: Read, least: float, most: int) -> Read:
    """Reads lists, each item of which takes `least` bytes at least; blanks where that is more than `most`."""

    def bounded(values: Any) -> Any:
        return read(values) if len(values) * least <= most else " " * (most + 1)

    return bounded


def _sequence_reader(kind: str, most: int | None) -> Read:
    if kind in _BYTES:
        return lambda values: b"".join(values) if isinstance(values, list) else bytes(values)
    if kind == "float":
        return all_shortest
    if "/" not in kind:
        return lambda values: values.tolist() if hasattr(values, "tolist") else list(values)
    one = _value_reader(kind, None, most)
    return lambda values: [one(value) for value in values]


def write(message: Any, data: Mapping[str, Any], place: str = "") -> Any:
    """Set fields of a message from plain data, and return it; raises `CodecError` with the field that does not fit."""
    types = message.get_fields_and_field_types()
    if not isinstance(data, Mapping):
        raise CodecError(f"{place}: {data!r} does not fit {type(message).__name__}")
    # Newer messages check what is set only where they are asked to.
    checked = type(message)(check_fields=True) if hasattr(message, "_check_fields") else message
    for name, value in data.items():
        where = f"{place}.{name}" if place else name
        if name not in types:
            raise CodecError(f"{where}: {type(message).__name__} has no such field")
        try:
            written = _written(types[name], getattr(message, name), value, where)
            setattr(checked, name, _checkable(types[name], written))
            setattr(message, name, written)
        except (AssertionError, TypeError, ValueError, OverflowError) as error:
            raise CodecError(f"{where}: {value!r} does not fit {types[name]} ({error})") from error
    return message


def _checkable(kind: str, written: Any) -> Any:
    """The value to check in place of another: rclpy's bound for 32-bit floats is below the largest one."""
    if kind == "float":
        return 0.0
    return [0.0] * len(written) if kind.startswith(("float[", "sequence<float")) else written


def _written(kind: str, current: Any, value: Any, where: str) -> Any:
    many = SEQUENCE.fullmatch(kind)
    if many:
        return _items(many["of"] or many["array"], value, where)
    if "/" in kind:
        return write(current, value, where)
    if kind in ("float", "double"):
        return _number(kind, value)
    if isinstance(value, bool) and kind != "boolean":  # Python takes it for an integer
        raise TypeError("it is a boolean")
    if kind in ("octet", "byte"):
        return bytes([value])
    if kind.startswith(("string", "wstring")) and not isinstance(value, str):
        raise TypeError("it is no text")
    return value


def _items(kind: str, value: Any, where: str) -> list[Any]:
    if kind in _BYTES and isinstance(value, str):
        data = base64.b64decode(value, validate=True)
        return list(data) if kind == "uint8" else [bytes([byte]) for byte in data]
    if not isinstance(value, (list, tuple)):
        raise TypeError("it is no list")
    message_type = load_type(kind) if "/" in kind else None
    items = []
    for i, item in enumerate(value):
        place = f"{where}[{i}]"
        try:
            items.append(_written(kind, message_type() if message_type else None, item, place))
        except (TypeError, ValueError, OverflowError) as error:
            raise CodecError(f"{place}: {item!r} does not fit {kind} ({error})") from error
    return items


def _number(kind: str, value: Any) -> float:
    """What JSON can't express comes as text; a 32-bit field gets the nearest 32-bit number."""
    if isinstance(value, bool) or (isinstance(value, str) and value not in _NO_NUMBERS):
        raise TypeError("it is no number")
    return float(struct.unpack("<" + kind[0], struct.pack("<" + kind[0], float(value)))[0])
