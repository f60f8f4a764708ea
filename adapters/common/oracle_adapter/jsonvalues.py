"""Message values as JSON text; where JSON can't express them, in the way of proto3's JSON.

NaN and the infinities are the strings `NaN`, `Infinity`, `-Infinity`; bytes are base64; tuples,
arrays and whatever else has `tolist` (numpy's arrays and scalars) are lists or numbers; integers
are exact, however large.
"""

from __future__ import annotations

import json
import math
import re
from base64 import b64encode
from typing import Any

_LONE_SURROGATE = re.compile("[\ud800-\udfff]")


def dumps(value: Any) -> str:
    """The value as compact JSON in ASCII, so that its length is also its size in bytes.

    Half surrogate pairs, which UTF-8 can't carry, become U+FFFD. Raises TypeError for what is no
    message value.
    """
    try:
        text = _ENCODER.encode(value)
    except ValueError:  # NaN or an infinity somewhere in it
        return _ENCODER.encode(_plain(value))
    # The encoder in C is some ten times faster than a walk in Python, which only rare values need.
    return _ENCODER.encode(_plain(value)) if "\\ud" in text else text


def _special(value: Any) -> Any:
    if isinstance(value, (bytes, bytearray, memoryview)):
        return b64encode(value).decode("ascii")
    if callable(getattr(value, "tolist", None)):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} can't be written as JSON")


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return _LONE_SURROGATE.sub("\ufffd", value)
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, float):
        return _json_number(value)
    if isinstance(value, dict):
        return {_plain(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return _plain(_special(value))


def _json_number(value: float) -> Any:
    if math.isfinite(value):
        return value
    if math.isnan(value):
        return "NaN"
    return "Infinity" if value > 0 else "-Infinity"


_ENCODER = json.JSONEncoder(allow_nan=False, separators=(",", ":"), default=_special)
