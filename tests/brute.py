"""The formula table read literally: slow, plain, and what every engine is compared with."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from operator import ge, gt, le, lt
from typing import TYPE_CHECKING, Any, Final

from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Bound, Constraint, Formula, Scalar

if TYPE_CHECKING:
    from oracle_server.core.formula.parse import Time

TimedSignals = tuple[int, Mapping[str, Scalar]]
"""A step: its time in nanoseconds and its signals."""


class Fresh:
    """A value that no signal has had yet: equal to nothing."""


FRESH: Final = Fresh()
UNSEEN_RELATE = os.environ.get("UNSEEN_RELATE") == "1"
"""Whether relations hold for a value that no signal has had yet: of none that is accepted it may matter."""
_ORDERS: Final[Mapping[str, Callable[[Any, Any], bool]]] = {"<": lt, "<=": le, ">": gt, ">=": ge}
Values = Mapping[str, Scalar | Fresh]
"""What each variable in scope stands for."""


def truths(formula: Formula, steps: Sequence[TimedSignals], time: Time) -> list[bool]:
    """Whether a formula holds, step by step."""
    return truths_for(formula, steps, time, {})


def judged(formula: Formula, steps: Sequence[TimedSignals], time: Time, begun: int) -> list[bool | None]:
    """Whether a property holds, step by step; None while too little of its session has passed to miss anything."""
    grace = presence(formula) if time == "seconds" else None
    ends = None if grace is None else begun + grace
    found = zip(steps, truths(formula, steps, time), strict=True)
    return [None if not holds and ends is not None and at < ends else holds for (at, _), holds in found]


def presence(formula: Formula) -> int | None:
    """The largest bound (ns) of a formula that is nothing but `once` with bounds, joined by `and`; else None."""
    match formula:
        case tree.Once(_, Bound(_, int(upper))):
            return upper
        case tree.And(left, right):
            one, other = presence(left), presence(right)
            return None if one is None or other is None else max(one, other)
    return None


def truths_for(formula: Formula, steps: Sequence[TimedSignals], time: Time, values: Values) -> list[bool]:
    """Whether a part holds, step by step, for values of its free variables."""
    now = range(len(steps))
    at = now if time == "steps" else [when for when, _ in steps]

    def of(part: Formula) -> list[bool]:
        return truths_for(part, steps, time, values)

    def within(bound: Bound, i: int) -> list[int]:
        """The past or present steps whose distance from step i lies in the bound."""
        upper = math.inf if bound.upper is None else bound.upper
        return [j for j in range(i + 1) if bound.lower <= at[i] - at[j] <= upper]

    match formula:
        case tree.Atom(constraints):
            return [all(meets(c, steps[i][1], values) for c in constraints) for i in now]
        case tree.Relation():
            return [relates(formula, values)] * len(steps)
        case tree.Not(operand):
            return [not holds for holds in of(operand)]
        case tree.And(left, right):
            return [p and q for p, q in zip(of(left), of(right), strict=True)]
        case tree.Or(left, right):
            return [p or q for p, q in zip(of(left), of(right), strict=True)]
        case tree.Implies(left, right):
            return [not p or q for p, q in zip(of(left), of(right), strict=True)]
        case tree.Pre(operand):
            return [False, *of(operand)][: len(steps)]
        case tree.Once(operand, bound):
            held = of(operand)
            return [any(held[j] for j in within(bound, i)) for i in now]
        case tree.Historically(operand, bound):
            held = of(operand)
            return [all(held[j] for j in within(bound, i)) for i in now]
        case tree.Since(left, right, bound):
            p, q = of(left), of(right)
            return [any(q[j] and all(p[j + 1 : i + 1]) for j in within(bound, i)) for i in now]
        case tree.Exists(variable, body):
            return [any(rows) for rows in _rows(variable, body, steps, time, values)]
        case tree.Forall(variable, body):
            return [all(rows) for rows in _rows(variable, body, steps, time, values)]
        case _:
            raise AssertionError(formula)  # `tests/obligations.py` reads what waits for what comes


def _rows(variable: str, body: Formula, steps: Sequence[TimedSignals], time: Time, values: Values) -> list[list[bool]]:
    """For each step, the truths of the body there: one a value seen so far, and a fresh one."""
    seen: list[tuple[int, Scalar | Fresh]] = [(0, FRESH)]
    for i, (_, signals) in enumerate(steps):
        seen += [(i, v) for v in signals.values() if not any(_equal(v, old) for _, old in seen)]
    bodies = [(i, truths_for(body, steps, time, {**values, variable: value})) for i, value in seen]
    return [[body[now] for since, body in bodies if since <= now] for now in range(len(steps))]


def _equal(left: Scalar | Fresh, right: Scalar | Fresh) -> bool:
    if isinstance(left, Fresh) or isinstance(right, Fresh):
        return False
    if isinstance(left, bool) or isinstance(right, bool):
        return left is right
    if isinstance(left, str) or isinstance(right, str):
        return isinstance(left, str) and isinstance(right, str) and left == right
    return left == right


def meets(constraint: Constraint, signals: Mapping[str, Scalar], values: Values) -> bool:
    """Whether a step's signals meet a constraint."""
    if constraint.key not in signals:
        return False
    found: Scalar = signals[constraint.key]
    wanted = constraint.value
    if isinstance(wanted, tree.Signal):
        if wanted.name not in signals:
            return False
        wanted = signals[wanted.name]
    if isinstance(wanted, tree.Limit):
        given = values[wanted.name]
        if isinstance(given, Fresh):
            return False
        wanted = given
    if isinstance(wanted, tree.Any):
        return True
    if isinstance(wanted, tree.Ref):
        return _equal(found, values[wanted.name])
    return _compares(found, constraint.op, wanted)


def relates(relation: tree.Relation, values: Values) -> bool:
    """Whether values compare as a relation says: one that no signal has had yet with none."""
    left, right = (values[s.name] if isinstance(s, tree.Ref) else s for s in (relation.left, relation.right))
    if isinstance(left, Fresh) or isinstance(right, Fresh):
        return UNSEEN_RELATE
    return _compares(left, relation.op, right)


def _compares(found: Scalar, op: str, wanted: Scalar) -> bool:
    if op in ("==", "!="):
        return _equal(found, wanted) == (op == "==")
    if isinstance(found, str | bool) or isinstance(wanted, str | bool):
        return False
    return _ORDERS[op](found, wanted)
