"""What formulas ask of a derived signal, and at which of its values the answer may turn."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import lru_cache

from oracle_server.core.atoms import canonical, meets, precedes
from oracle_server.core.derived.samples import FAILED, Lack, Value
from oracle_server.core.formula.tree import Any, Constraint, Ref, Scalar

Answer = str | bool | None
"""Whether a value meets a constraint, or which one a variable takes; None where it is absent."""
_OLDEST = 2**63 // 10**9
"""Seconds that no age reaches, since stamps are nanoseconds below 2^63: who sends more means that there is no limit."""


def answer(constraint: Constraint, value: Value | None) -> Answer:
    """What a constraint comes to."""
    if value is None:
        return None
    if value is FAILED:
        return "failed"
    assert not isinstance(value, Lack)  # noqa: S101 -- there are no others
    return canonical(value) if isinstance(constraint.value, Ref) else meets(constraint, value)


def answer_beside(constraint: Constraint, value: Value | None, other: Value | None) -> Answer:
    """What a comparison of two signals comes to."""
    if value is FAILED or other is FAILED:
        return "failed"
    if value is None or other is None:
        return None
    assert not isinstance(value, Lack)  # noqa: S101 -- there are no others
    assert not isinstance(other, Lack)  # noqa: S101 -- there are no others
    return precedes(value, constraint.op, other)


def border(constraint: Constraint) -> Fraction | None:
    """The number around which alone the answer turns; None where it may turn anywhere."""
    wanted = constraint.value
    if isinstance(wanted, Any | str | bool):
        return Fraction(0)  # it turns nowhere
    if isinstance(wanted, int | float) and math.isfinite(wanted):
        return Fraction(wanted)
    return None


def counts_below(count: int, asked: Constraint, per_one: Fraction) -> Iterator[int] | None:
    """Counts below one at which alone the answer about them may turn, the largest first.

    `per_one` is by how much the signal grows with one more. None where it may turn at each.
    """
    found = border(asked)
    if found is None:
        return None
    middle = math.floor(found / per_one)
    near = {count - 1, *range(middle - 2, middle + 4)}
    return iter(sorted((n for n in near if 0 <= n < count), reverse=True))


def first_turn(values: Sequence[Scalar], begin: int, asked: Constraint, sign: int) -> int | None:
    """Of values that grow, the first behind `begin` at which an answer turns, None where at none of them.

    `sign` is -1 where the values are kept negated.
    """
    now = answer(asked, _signed(values[begin], sign))
    found = border(asked)
    near = {begin + 1}
    if found is not None:
        at: float | Fraction = found * sign
        near |= {bisect_left(values, at, begin + 1), bisect_right(values, at, begin + 1)}
    turns = (i for i in sorted(near) if i < len(values) and answer(asked, _signed(values[i], sign)) != now)
    return next(turns, None)


@lru_cache(maxsize=256)
def turning_ages(asked: tuple[Constraint, ...], seconds: Callable[[int], float]) -> tuple[int, ...]:
    """The ages (ns) at which an answer turns, the least first; none that no session grows to."""
    found: set[int] = set()
    for each in asked:
        middle = border(each)
        if middle is None or not 0 <= middle < _OLDEST or not isinstance(each.value, int | float):
            continue
        nearest = math.floor(middle * 10**9)
        margin = 2 + (nearest >> 50)
        near = range(max(0, nearest - margin), nearest + margin + 2)
        at = float(middle)
        turns = (bisect_left(near, at, key=seconds), bisect_right(near, at, key=seconds))
        ages = (near[i] for i in turns if i < len(near))
        found |= {a for a in ages if a and answer(each, seconds(a)) != answer(each, seconds(a - 1))}
    return tuple(sorted(found))


def _signed(value: Scalar, sign: int) -> Scalar:
    assert not isinstance(value, str)  # noqa: S101 -- only numbers are kept so
    return value * sign
