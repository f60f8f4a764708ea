"""ROS 1 messages to plain data for JSON, and plain data to messages.

Only the fields that are asked for are read. Times and durations have `sec` and `nanosec`, as on ROS 2 and in bags;
`secs` and `nsecs` are read where they are asked for by these names. A 32-bit float is its shortest decimal; uint8
sequences are bytes, which JSON carries as base64; every other sequence is a list.
"""

from __future__ import annotations

import base64
import keyword
import re
import struct
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence

import genpy
from oracle_adapter.fields import grouped, shortest

Read = Callable[[Any], Any]
Lookup = Callable[[str], Any]
"""The class of a nested type's name, as `pkg/Type`."""

ARRAY = re.compile(r"(?P<of>.+)\[(?P<size>\d*)\]")
BYTES = frozenset({"uint8", "char"})
_TIMES = {"time": genpy.Time, "duration": genpy.Duration}
_TIME_NAMES = {"sec": "secs", "nanosec": "nsecs", "secs": "secs", "nsecs": "nsecs"}
_INTEGERS = {
    "int8": "b", "byte": "b", "uint8": "B", "char": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q",
}  # fmt: skip
_FLOATS = {"float32": "f", "float64": "d"}


class CodecError(Exception):
    """Data that does not fit a message type, with its field; or a type that is not installed."""


def reader(message_type: Any, fields: Optional[Iterable[str]], lookup: Lookup) -> Read:
    """A function from messages to plain data with these dotted fields; None means all of them.

    Fields that the type does not have are left out.
    """
    types = types_of(message_type)
    wanted: Mapping[str, Optional[Sequence[str]]]
    wanted = dict.fromkeys(map(sent_name, types)) if fields is None else grouped(fields)
    slots = [(name, attribute(name), inner) for name, inner in wanted.items()]
    parts = [(name, slot, _value_reader(types[slot], inner, lookup)) for name, slot, inner in slots if slot in types]
    return lambda message: {name: read(getattr(message, slot)) for name, slot, read in parts}


def lacking(message_type: Any, paths: Iterable[str], lookup: Lookup) -> List[str]:
    """Those of some dotted paths at which the type has nothing."""
    return [path for path in paths if not _has(message_type, path.split("."), lookup)]


def _has(message_type: Any, names: Sequence[str], lookup: Lookup) -> bool:
    kind = types_of(message_type).get(attribute(names[0]))
    if kind is None or len(names) == 1:
        return kind is not None
    if kind in _TIMES:
        return len(names) == 2 and names[1] in _TIME_NAMES
    return "/" in kind and not ARRAY.fullmatch(kind) and _has(lookup(kind), names[1:], lookup)


def types_of(message_type: Any) -> Dict[str, str]:
    """A message's fields, by the names that genpy has for them, and their types."""
    return dict(zip(message_type.__slots__, message_type._slot_types))  # noqa: SLF001 - genpy's own interface


def attribute(name: str) -> str:
    """What genpy calls a field in Python, where words such as `from` can't be names."""
    return f"{name}_" if keyword.iskeyword(name) or name == "self" else name


def sent_name(slot: str) -> str:
    """What a field is called in definitions that genpy calls so."""
    return slot[:-1] if slot == attribute(slot[:-1]) else slot


def _value_reader(kind: str, inner: Optional[Sequence[str]], lookup: Lookup) -> Read:
    array = ARRAY.fullmatch(kind)
    if array:
        return _array_reader(array["of"], lookup)
    if kind in _TIMES:
        names = [(name, _TIME_NAMES[name]) for name in inner or ("sec", "nanosec") if name in _TIME_NAMES]
        return lambda value: {name: getattr(value, own) for name, own in names}
    if "/" in kind:
        return reader(lookup(kind), inner, lookup)
    if kind == "float32":
        return shortest
    return bool if kind == "bool" else _same  # a bool that was set in Python may be a number


def _array_reader(kind: str, lookup: Lookup) -> Read:
    if kind in BYTES:
        return bytes
    one = _value_reader(kind, None, lookup)
    return list if one is _same else lambda values: [one(value) for value in values]


def _same(value: Any) -> Any:
    return value


def write(message: Any, data: Mapping[str, Any], lookup: Lookup, place: str = "") -> Any:
    """Set fields of a message from plain data, and return it; raises `CodecError` with the field that does not fit."""
    name = type(message)._type  # noqa: SLF001 - genpy's own interface
    if not isinstance(data, Mapping):
        raise CodecError(f"{place}: {data!r} does not fit {name}")
    types = types_of(type(message))
    for field, value in data.items():
        where = f"{place}.{field}" if place else field
        slot = attribute(field)
        if slot not in types:
            raise CodecError(f"{where}: {name} has no such field")
        setattr(message, slot, _written(types[slot], getattr(message, slot), value, where, lookup))
    return message


def _written(kind: str, current: Any, value: Any, where: str, lookup: Lookup) -> Any:
    array = ARRAY.fullmatch(kind)
    if array:
        return _array(array, value, where, lookup)
    if "/" in kind:
        return write(lookup(kind)() if current is None else current, value, lookup, where)
    if kind in _TIMES:
        return _time(kind, value, where)
    try:
        return _scalar(kind, value)
    except (struct.error, TypeError, ValueError, OverflowError):
        raise CodecError(f"{where}: {value!r} does not fit {kind}") from None


def _array(array: "re.Match[str]", value: Any, where: str, lookup: Lookup) -> Any:
    kind, size = array["of"], array["size"]
    values: Any
    if kind in BYTES and isinstance(value, str):
        try:
            values = base64.b64decode(value, validate=True)
        except ValueError:
            raise CodecError(f"{where}: {value!r} is not base64, as {kind} sequences are") from None
    elif isinstance(value, (list, tuple)):
        values = [_written(kind, None, item, f"{where}[{i}]", lookup) for i, item in enumerate(value)]
        values = bytes(values) if kind in BYTES else values
    else:
        raise CodecError(f"{where}: {value!r} does not fit {array[0]}")
    if size and len(values) != int(size):
        raise CodecError(f"{where}: {len(values)} items do not fit {array[0]}")
    return values


def _time(kind: str, value: Any, where: str) -> Any:
    if not isinstance(value, Mapping):
        raise CodecError(f"{where}: {value!r} does not fit {kind}")
    parts = {"secs": 0, "nsecs": 0}
    for name, number in value.items():
        if name not in _TIME_NAMES:
            raise CodecError(f"{where}.{name}: a {kind} has no such field")
        if type(number) is not int or not -(2**31) <= number < 2**32:
            raise CodecError(f"{where}.{name}: {number!r} does not fit {kind}")
        parts[_TIME_NAMES[name]] = number
    try:
        return _TIMES[kind](parts["secs"], parts["nsecs"])
    except (TypeError, ValueError):
        raise CodecError(f"{where}: {value!r} does not fit {kind}") from None


def _scalar(kind: str, value: Any) -> Any:
    if kind in _FLOATS:
        if isinstance(value, bool):
            raise TypeError
        layout = "<" + _FLOATS[kind]
        return struct.unpack(layout, struct.pack(layout, float(value)))[0]
    if kind in _INTEGERS:
        if type(value) is not int:
            raise TypeError
        struct.pack("<" + _INTEGERS[kind], value)
        return value
    if not isinstance(value, bool if kind == "bool" else str):
        raise TypeError
    return value
