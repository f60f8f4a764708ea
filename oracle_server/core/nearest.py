"""The names that somebody who wrote another one may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_MOST = 12
_CLOSE = 0.1
"""How much less alike a second name may be."""
_RENAMED = {"nsec": "nanosec", "nsecs": "nanosec", "secs": "sec"}
"""What fields of ROS 1 are called on ROS 2: other names are written more like them."""


def near(name: str, known: Iterable[str], alike: float = 0.65) -> list[str]:
    """The known names that are most like one, two at the most, the likeliest first.

    `alike` is how much so: 1 for the same.
    """
    by_lower = {other.lower(): other for other in sorted(known)}
    lower = name.lower()
    if _RENAMED.get(lower) in by_lower:
        return [by_lower[_RENAMED[lower]]]
    found = difflib.get_close_matches(lower, by_lower, n=2, cutoff=alike)
    ratios = [difflib.SequenceMatcher(None, match, lower).ratio() for match in found]
    return [by_lower[match] for match, ratio in zip(found, ratios, strict=True) if ratio > ratios[0] - _CLOSE]


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
