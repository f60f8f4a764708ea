"""Durations, sizes and counts as people write them."""

from __future__ import annotations

import re
from fractions import Fraction

from oracle_server.core.formula.foreign import UNITS
from oracle_server.core.formula.tree import NANOSECONDS

_DURATION = re.compile(r"(\d{1,12}(?:\.\d{1,9})?)(ns|us|ms|s|min|h)")
_LOOSE = re.compile(r"\s*(\d+(?:[.,]\d+)?)\s*([^\W\d]*)\s*")
_SIZE = re.compile(r"(\d{1,9})(k|M|G)B")
_LOOSE_SIZE = re.compile(r"\s*(\d{1,9})\s*([kmg])i?b?\s*", re.IGNORECASE)
_SIZES = {"k": "k", "m": "M", "g": "G"}
_UNITS = {"k": 10**3, "M": 10**6, "G": 10**9}
_LONGEST = 10**18


def duration(value: object) -> int:
    """Nanoseconds of a duration such as `20ms`, `2s` or `1.5s`. Raises ValueError for anything else."""
    match = _DURATION.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise ValueError(f"expected a duration such as 20ms, 2s or 1.5s, found {value!r}{_nearest(value)}")
    exact = Fraction(match[1]) * NANOSECONDS[match[2]]
    if exact != int(exact) or exact > _LONGEST:
        raise ValueError(f"the duration {value} is finer than a nanosecond or too long")
    return int(exact)


def kept(bound: int) -> int:
    """A bound on what is kept, which is none where it is 0, as other limits are. Raises ValueError for that."""
    if bound == 0:
        raise ValueError("nothing would be kept; leave it out where all is to be")
    return bound


def span(nanoseconds: int) -> str:
    """A duration as it is written, in the largest unit up to seconds that has no fraction."""
    for unit in ("s", "ms", "us"):
        if nanoseconds % NANOSECONDS[unit] == 0:
            return f"{nanoseconds // NANOSECONDS[unit]}{unit}"
    return f"{nanoseconds}ns"


def counted(number: int, noun: str) -> str:
    """A number with its noun, which takes an `s` for any number but 1."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _nearest(value: object) -> str:
    """What to write for a duration in other units, or without one."""
    match = _LOOSE.fullmatch(str(value)) if isinstance(value, str | int | float) else None
    if match is None or isinstance(value, bool):
        return ""
    number = match[1].replace(",", ".")
    if not match[2]:
        return f"; a unit is missing: write {number}s or {number}ms"
    if match[2].lower() in ("d", "day", "days") and number.isdigit():
        return f"; write {int(number) * 24}h"
    unit = UNITS.get(match[2].lower(), match[2].lower())
    if unit not in NANOSECONDS:
        return "; the units are ns, us, ms, s, min and h"
    written = f"{number}{unit}"
    return f"; write {written}" if written != value else "; it has at most 12 digits, and 9 behind the point"


def size(value: object) -> int:
    """Bytes of a size such as `500MB` or `2GB`. Raises ValueError for anything else."""
    match = _SIZE.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        loose = _LOOSE_SIZE.fullmatch(value) if isinstance(value, str) else None
        mend = f"; write {loose[1]}{_SIZES[loose[2].lower()]}B" if loose else ""
        raise ValueError(f"expected a size such as 500MB or 2GB, found {value!r}{mend}")
    return int(match[1]) * _UNITS[match[2]]
