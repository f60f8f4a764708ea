"""The names that somebody who wrote another one may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_MOST = 12


def nearest(name: str, known: Iterable[str], alike: float = 0.7) -> str:
    """What to say of the known names that are most like one: `did you mean 'a' or 'b'?`, empty where none is.

    `alike` is how much so: 1 for the same.
    """
    by_lower = {other.lower(): other for other in sorted(known)}
    found = difflib.get_close_matches(name.lower(), by_lower, n=2, cutoff=alike)
    return f"did you mean {' or '.join(repr(by_lower[lower]) for lower in found)}?" if found else ""


def either(names: Iterable[str]) -> str:
    """Names of which any may be meant, the first of many."""
    found = list(names)
    return " or ".join(found[:_MOST]) + (f" or {len(found) - _MOST} more" if len(found) > _MOST else "")


def listed(names: Iterable[str]) -> str:
    """Names in one line, the first of many."""
    found = list(names)
    return ", ".join(found[:_MOST]) + (f" and {len(found) - _MOST} more" if len(found) > _MOST else "")
