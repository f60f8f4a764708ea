"""The values of a step that are beyond the bounds for which a formula fails at it.

Only what the step itself shows is looked at. An explanation tells more, and is made where a property becomes negative:
what a value comes to while it stays so is told by this.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple, TypeGuard

from oracle_server.core.atoms import meets, precedes
from oracle_server.core.formula.tree import (
    And,
    Atom,
    Constraint,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Limit,
    Not,
    Once,
    Or,
    Scalar,
    Signal,
    atoms,
)

_OPPOSITE: Mapping[str, str] = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}


class Beyond(NamedTuple):
    """A signal's value that is beyond what it must be: `op bound`, which is the value of the signal `than`, if any."""

    signal: str
    op: str
    bound: float
    value: float
    than: str | None


Found = tuple[Beyond, ...] | None
"""The values beyond bounds by which a formula comes to a truth value; None where it is not seen that it does."""


def has_bounds(formula: Formula) -> bool:
    """Whether a formula compares any signal with a number, or with another signal."""
    return any(
        constraint.op in _OPPOSITE and not isinstance(constraint.value, Limit)
        for atom in atoms(formula)
        for constraint in atom.constraints
    )


def beyond(formula: Formula, signals: Mapping[str, Scalar], *, fails: bool) -> tuple[Beyond, ...]:
    """The values of a step, by its signals, for which a formula fails at it.

    `fails`: it is known to fail at this step; else nothing is found where that is not seen by the signals alone.
    """
    return _by(formula, signals, to=False, known=fails) or ()


def _by(formula: Formula, signals: Mapping[str, Scalar], *, to: bool, known: bool) -> Found:
    """What a part comes `to` a truth value by; `known`: it does so, whether that is seen here or not."""
    found: Found = None
    match formula:
        case Atom():
            found = _by_atom(formula, signals, to=to)
        case Not(operand):
            found = _by(operand, signals, to=not to, known=known)
        case Implies(left, right):
            found = _by(Or(Not(left), right), signals, to=to, known=known)
        case And() | Or():
            found = _by_sides(formula, signals, to=to, known=known)
        case Historically(operand, bound) | Once(operand, bound) if bound.lower == 0:
            one_is_enough = isinstance(formula, Once) is to
            if one_is_enough or known:
                found = _by(operand, signals, to=to, known=not one_is_enough)
        case Forall(variable, body) | Exists(variable, body):
            if isinstance(formula, Exists) is to and _is_bound_by_one_signal(variable, body):
                found = _by(body, signals, to=to, known=False)
        case _:
            pass
    return found


def _by_sides(formula: And | Or, signals: Mapping[str, Scalar], *, to: bool, known: bool) -> Found:
    both = isinstance(formula, And) is to
    found = [_by(side, signals, to=to, known=known and both) for side in (formula.left, formula.right)]
    seen = [side for side in found if side is not None]
    if len(seen) < (1 if known or not both else 2):
        return None
    return tuple([value for side in seen for value in side])


def _by_atom(atom: Atom, signals: Mapping[str, Scalar], *, to: bool) -> Found:
    """The same of an atom; what it compares with a variable depends on more than the step."""
    plain = [c for c in atom.constraints if not isinstance(c.value, Limit)]
    unmet = [c for c in plain if not _is_met(c, signals)]
    if to:
        seen = not unmet and len(plain) == len(atom.constraints) and _binds_each_once(atom)
        return tuple(_values(plain, signals, forbidden=True)) if seen else None
    return tuple(_values(unmet, signals, forbidden=False)) if unmet else None


def _is_met(constraint: Constraint, signals: Mapping[str, Scalar]) -> bool:
    value = signals.get(constraint.key)
    if value is None or not meets(constraint, value):
        return False
    other = constraint.value
    return not isinstance(other, Signal) or precedes(value, constraint.op, signals.get(other.name))


def _values(constraints: list[Constraint], signals: Mapping[str, Scalar], *, forbidden: bool) -> Iterator[Beyond]:
    for constraint in constraints:
        than = constraint.value.name if isinstance(constraint.value, Signal) else None
        bound = constraint.value if than is None else signals.get(than)
        value = signals.get(constraint.key)
        if constraint.op in _OPPOSITE and _is_number(bound) and _is_number(value):
            op = _OPPOSITE[constraint.op] if forbidden else constraint.op
            yield Beyond(constraint.key, op, bound, value, than)


def _binds_each_once(atom: Atom) -> bool:
    names = [name for _, name in atom.refs]
    return len(names) == len({*names})


def _is_bound_by_one_signal(variable: str, body: Formula) -> bool:
    """Whether the only value of a variable that a step can show is that of one signal."""
    keys = {key for atom in atoms(body) for key, name in atom.refs if name == variable}
    return len(keys) == 1 and not any(atom.limits for atom in atoms(body))


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
