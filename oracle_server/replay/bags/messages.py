"""Converts messages of a bag to plain data, as an adapter would have sent them.

A 32-bit float becomes its shortest decimal, a byte sequence a base64 text, NaN and infinities the wire's texts for
them, and every other array a list, as are the signed numbers of ROS 1's `byte[]`. A single `byte` is signed in ROS 1,
too, and not in ROS 2.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore

from oracle_server.core.errors import TraceError

Read = Callable[[Any], Any]
_TIMES = {"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"}
_OLD_NAMES = {"secs": "sec", "nsecs": "nanosec"}
_BYTES = frozenset({"uint8", "octet", "byte", "char"})
_OCTETS = frozenset({"byte", "octet"})
_BYTES_OF_ROS1 = frozenset({"uint8", "char"})


def message_reader(types: Typestore, name: str, paths: Iterable[str] | None, *, ros1: bool = False) -> Read:
    """A function from decoded messages to plain data with the fields of these dotted paths, None for all.

    Fields that the type does not have are left out. Raises `TraceError` where a type is unknown.
    """
    if name not in types.fielddefs:
        raise TraceError(f"the type {name} is unknown; give the folder of its .msg files with --types")
    fields = dict(types.fielddefs[name][1])
    wanted: dict[str, list[str] | None] = dict.fromkeys(fields) if paths is None else _grouped(paths)
    parts = []
    for field, inner in wanted.items():
        own = _OLD_NAMES.get(field, field) if name in _TIMES else field
        if own in fields:
            attribute = normalize_fieldname(own)  # a word of Python's is no attribute's name
            parts.append((field, attribute, _value_reader(types, fields[own], inner, ros1=ros1)))
    return lambda message: {field: read(getattr(message, attribute)) for field, attribute, read in parts}


class _Text(bytes):
    """The bytes of a text as ROS reads them in Python: what is no UTF-8 is replaced."""

    def decode(self, encoding: str = "utf-8", errors: str = "replace") -> str:
        return super().decode(encoding, errors)


def ros1_decoder(types: Typestore) -> Callable[[bytes, str], Any]:
    """What decodes serialized messages of ROS 1, of a type by name."""
    read_any_text(types)
    return types.deserialize_ros1


def read_any_text(types: Typestore) -> None:
    """Have the texts in messages of these types read whatever their bytes, as `_Text` has it."""
    for name in types.fielddefs:  # rosbags makes code for each type, which takes texts by `bytes(…).decode()`
        known = types.get_msgdef(name)
        for decode in (known.deserialize_ros1, known.deserialize_cdr_le, known.deserialize_cdr_be):
            decode.__globals__["bytes"] = _Text


def _grouped(paths: Iterable[str]) -> dict[str, list[str] | None]:
    """Dotted paths by their first name; None stands for the whole value."""
    grouped: dict[str, list[str] | None] = {}
    for path in sorted(paths):
        name, _, rest = path.partition(".")
        inner = grouped.setdefault(name, [])
        if not rest:
            grouped[name] = None
        elif inner is not None:
            inner.append(rest)
    return grouped


def _value_reader(types: Typestore, kind: Any, inner: list[str] | None, *, ros1: bool) -> Read:
    node, of = kind
    if node == Nodetype.NAME:
        return message_reader(types, of, inner, ros1=ros1)
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element = of[0]
        if element[0] == Nodetype.BASE and element[1][0] in (_BYTES_OF_ROS1 if ros1 else _BYTES):
            return lambda values: base64.b64encode(bytes(values)).decode()
        one = _value_reader(types, element, None, ros1=ros1)
        return lambda values: [one(v) for v in (values.tolist() if isinstance(values, np.ndarray) else values)]
    if of[0] in _OCTETS and not ros1:
        return _octet
    return {"float32": _single, "float64": _double}.get(of[0], _same)


def _single(value: float) -> float | str:
    return float(str(np.float32(value))) if math.isfinite(value) else _double(value)


def _double(value: float) -> float | str:
    if math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"


def _octet(value: int) -> int:
    """A byte of ROS 2, where it is no signed number, as it is in ROS 1, and as it was decoded."""
    return value & 0xFF


def _same(value: Any) -> Any:
    return value
