"""Comparisons of two signals: those that contradict each other, and what a pair of signals can come to."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, get_args

from oracle_server.core.formula.tree import Constraint, Signal

Sign = Literal[-1, 0, 1]
"""Whether the first of two numbers is less than the second, equal to it, or more."""
_MET: dict[str, tuple[Sign, ...]] = {"<": (-1,), "<=": (-1, 0), ">": (1,), ">=": (0, 1)}
_TURNED: dict[str, Literal["<", "<=", ">", ">="]] = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}


def turned(constraint: Constraint) -> Constraint:
    """The same comparison as one of the other signal."""
    assert isinstance(constraint.value, Signal)  # noqa: S101 -- a comparison of signals
    return Constraint(constraint.value.name, _TURNED[constraint.op], Signal(constraint.key))


def contradictory(constraints: Sequence[Constraint]) -> list[Constraint]:
    """Comparisons of the same two signals which no two numbers meet together; empty where there are none."""
    pairs: dict[tuple[str, str], list[Constraint]] = {}
    for constraint in constraints:
        if isinstance(constraint.value, Signal):
            other = constraint.value.name
            pairs.setdefault((min(constraint.key, other), max(constraint.key, other)), []).append(constraint)
    for (first, _), own in pairs.items():
        if len(own) > 1 and not any(all(met(c if c.key == first else turned(c), s) for c in own) for s in signs()):
            return own
    return []


def signs() -> Iterator[Sign]:
    """The ways in which two numbers can differ."""
    yield from get_args(Sign)


def met(constraint: Constraint, sign: Sign) -> bool:
    """Whether a comparison is met where its signals differ so."""
    return sign in _MET[constraint.op]


def others(constraints: Iterable[Constraint]) -> list[str]:
    """The signals with which constraints compare, each once."""
    return list(dict.fromkeys(c.value.name for c in constraints if isinstance(c.value, Signal)))
