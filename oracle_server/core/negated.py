"""The bounds of formulas that say what a signal must not be, as `not {speed > 3}`: of these no reason fails."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple, TypeGuard

from oracle_server.core.errors import OracleError
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.tree import Formula, Scalar, Signal

_OPPOSITE: Mapping[str, str] = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}
_HOLDS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip
_TIMES: tuple[Time, ...] = ("seconds", "steps")


class Beyond(NamedTuple):
    """A signal's value that is beyond what it must be: `op bound`, which is the value of the signal `than`, if any."""

    signal: str
    op: str
    bound: float
    value: float
    than: str | None


def beyond(formula: str, signals: Mapping[str, Scalar]) -> Iterator[Beyond]:
    """The values of a step at which a formula is violated that it forbids; none where it forbids more than one atom."""
    atom = _forbidden(formula)
    for constraint in () if atom is None else atom.constraints:
        than = constraint.value.name if isinstance(constraint.value, Signal) else None
        bound = constraint.value if than is None else signals.get(than)
        value = signals.get(constraint.key)
        if constraint.op not in _OPPOSITE or not _is_number(bound) or not _is_number(value):
            continue
        if _HOLDS[constraint.op](value, bound):
            yield Beyond(constraint.key, _OPPOSITE[constraint.op], bound, value, than)


@lru_cache(maxsize=1_000)
def _forbidden(formula: str) -> tree.Atom | None:
    """The only atom that a formula forbids at the last step; None where there is none, or several, or no formula."""
    for time in _TIMES:
        try:
            found = [*_negated(parse_formula(formula, time))]
        except OracleError:  # one of another engine, or with names of `define:`
            continue
        return found[0] if len(found) == 1 else None
    return None


def _negated(formula: Formula) -> Iterator[tree.Atom]:
    """The atoms that must not hold at the last step where a formula is to hold."""
    match formula:
        case tree.Not(tree.Atom() as atom):
            yield atom
        case tree.Not(tree.Or(left, right)):
            yield from _negated(tree.Not(left))
            yield from _negated(tree.Not(right))
        case tree.And(left, right):
            yield from _negated(left)
            yield from _negated(right)
        case tree.Implies(_, right) | tree.Forall(_, right) | tree.Historically(right):
            yield from _negated(right)
        case _:
            pass


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
