"""Properties that only demand presence, and their grace: nothing is missing before there was time for it to come."""

from __future__ import annotations

from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import And, Formula, Once


def grace(formula: Formula, time: Time) -> int:
    """How long (ns) after its session's begin a property is not judged negative; 0 for all but presence properties.

    These are with `time: seconds`, and nothing but conjunctions of `once` with an upper bound: the largest bound
    counts.
    """
    return (_longest(formula) or 0) if time == "seconds" else 0


def _longest(formula: Formula) -> int | None:
    match formula:
        case Once(_, bound):
            return bound.upper
        case And(left, right):
            sides = _longest(left), _longest(right)
            return None if None in sides else max(side for side in sides if side is not None)
    return None
