"""The names that somebody who wrote another one may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_MOST = 12
_CLOSE = 0.1
"""How much less alike a second name may be."""
_RENAMED = {"nsec": "nanosec", "nsecs": "nanosec", "secs": "sec"}
"""What fields of ROS 1 are called on ROS 2: other names are written more like them."""
_PAIRS = 40_000
"""Pairs of characters that are compared, some 20 ms at the most: of a thousand names of 60 it would be seconds."""


def near(name: str, known: Iterable[str], alike: float = 0.65) -> list[str]:
    """The known names that are most like one, two at the most, the likeliest first.

    `alike` is how much so: 1 for the same.
    """
    by_lower = {other.lower(): other for other in sorted(known)}
    lower = name.lower()
    if _RENAMED.get(lower) in by_lower:
        return [by_lower[_RENAMED[lower]]]
    found = _closest(lower, by_lower, alike)
    return [by_lower[other] for ratio, other in found if ratio > found[0][0] - _CLOSE]


def _closest(name: str, known: Iterable[str], alike: float) -> list[tuple[float, str]]:
    """The two names most like one, with how much so; of many that may be, those with the most characters in common."""
    matcher = difflib.SequenceMatcher(None, "", name)
    maybe: list[tuple[float, str]] = []
    for other in known:
        matcher.set_seq1(other)
        if matcher.real_quick_ratio() >= alike and (most := matcher.quick_ratio()) >= alike:
            maybe.append((most, other))
    found: list[tuple[float, str]] = []
    pairs = 0
    for most, other in sorted(maybe, reverse=True):
        if pairs > _PAIRS or (len(found) == 2 and most < found[1][0]):  # none that follows is more alike
            break
        pairs += len(name) * len(other)
        matcher.set_seq1(other)
        if (ratio := matcher.ratio()) >= alike:
            found = sorted([*found, (ratio, other)], reverse=True)[:2]
    return found


def nearest(name: str, known: Iterable[str], alike: float = 0.65) -> str:
    """What to say of those names: ``did you mean `a` or `b`?``, empty where none is alike."""
    found = near(name, known, alike)
    return f"did you mean {' or '.join(f'`{other}`' for other in found)}?" if found else ""


def either(names: Iterable[str]) -> str:
    """Names of which any may be meant, the first of many."""
    found = list(names)
    return " or ".join(found[:_MOST]) + (f" or {len(found) - _MOST} more" if len(found) > _MOST else "")


def listed(names: Iterable[str]) -> str:
    """Names in one line, the first of many."""
    found = list(names)
    return ", ".join(found[:_MOST]) + (f" and {len(found) - _MOST} more" if len(found) > _MOST else "")
