"""The values of a step that are beyond the bounds for which a formula fails at it.

Only what the step itself shows is looked at. An explanation tells more, and is made where a property becomes negative:
what a value comes to while it stays so is told by this.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeGuard

from oracle_server.core.atoms import meets, precedes
from oracle_server.core.events import Signals
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
Look = Callable[[Signals], Found]
"""What finds them among the signals of a step: made once of a formula, and asked at each step at which that fails."""


def looking(formula: Formula, *, fails: bool) -> Look | None:
    """What finds the values of a step for which a formula fails at it; None where no value can be found.

    `fails`: it is asked only where the formula is known to fail; else nothing is found where that is not seen by the
    signals alone.
    """
    return _by(formula, to=False, known=fails) if _has_bounds(formula) else None


def _by(formula: Formula, *, to: bool, known: bool) -> Look | None:
    """What finds by what a part comes `to` a truth value; `known`: it does so, whether that is seen here or not."""
    look: Look | None = None
    match formula:
        case Atom():
            look = _true(formula) if to else _false(formula)
        case Not(operand):
            look = _by(operand, to=not to, known=known)
        case Implies(left, right):
            look = _by(Or(Not(left), right), to=to, known=known)
        case And() | Or():
            look = _by_sides(formula, to=to, known=known)
        case Historically(operand, bound) | Once(operand, bound) if bound.lower == 0:
            one_is_enough = isinstance(formula, Once) is to
            if one_is_enough or known:
                look = _by(operand, to=to, known=not one_is_enough)
        case Forall(variable, body) | Exists(variable, body):
            if isinstance(formula, Exists) is to and _is_bound_by_one_signal(variable, body):
                look = _by(body, to=to, known=False)
        case _:
            pass
    return look


def _by_sides(formula: And | Or, *, to: bool, known: bool) -> Look | None:
    both = isinstance(formula, And) is to
    sides = [side for side in (formula.left, formula.right) if _has_bounds(side) or not (both and known)]
    looks = [look for side in sides if (look := _by(side, to=to, known=known and both)) is not None]
    least = 1 if known or not both else 2
    if len(looks) < least:
        return None
    return looks[0] if len(looks) == 1 else _together(*looks, least=least)


def _together(one: Look, other: Look, *, least: int) -> Look:
    """What both find; None where fewer than `least` of them do."""

    def look(signals: Signals) -> Found:
        first, second = one(signals), other(signals)
        if first is None or second is None:
            return None if least > 1 else second if first is None else first
        return first + second

    return look


def _true(atom: Atom) -> Look | None:
    """Where an atom holds, the values that must not be so; what it compares with a variable no step shows."""
    names = [name for _, name in atom.refs]
    if atom.limits or len(names) > len({*names}):
        return None
    tests = [(_met(constraint), _value(constraint, forbidden=True)) for constraint in atom.constraints]

    def look(signals: Signals) -> Found:
        found: tuple[Beyond, ...] = ()
        for is_met, value in tests:
            if not is_met(signals):
                return None
            found += () if value is None else value(signals)
        return found

    return look


def _false(atom: Atom) -> Look | None:
    """Where an atom does not hold, the values that do not meet it."""
    plain = [constraint for constraint in atom.constraints if not isinstance(constraint.value, Limit)]
    tests = [(_met(constraint), _value(constraint, forbidden=False)) for constraint in plain]

    def look(signals: Signals) -> Found:
        found: Found = None
        for is_met, value in tests:
            if not is_met(signals):
                found = (found or ()) + (() if value is None else value(signals))
        return found

    return look if tests else None


def _met(constraint: Constraint) -> Callable[[Signals], bool]:
    """Whether a signal is there and meets a constraint; a variable is met by all."""
    key, op, other = constraint.key, constraint.op, constraint.value
    if isinstance(other, Signal):
        return lambda signals: precedes(signals.get(key), op, signals.get(other.name))
    return lambda signals: (value := signals.get(key)) is not None and meets(constraint, value)


def _value(constraint: Constraint, *, forbidden: bool) -> Callable[[Signals], tuple[Beyond, ...]] | None:
    """What makes the value of a bound; None where a constraint is none."""
    if constraint.op not in _OPPOSITE:
        return None
    key, op, other = constraint.key, constraint.op, constraint.value
    wanted = _OPPOSITE[op] if forbidden else op
    if not isinstance(other, Signal):
        bound = other if _is_number(other) else 0
        return lambda signals: (
            (Beyond(key, wanted, bound, value, None),) if _is_number(value := signals.get(key)) else ()
        )
    than = other.name

    def compared(signals: Signals) -> tuple[Beyond, ...]:
        value, bound = signals.get(key), signals.get(than)
        return (Beyond(key, wanted, bound, value, than),) if _is_number(value) and _is_number(bound) else ()

    return compared


def _has_bounds(formula: Formula) -> bool:
    """Whether a formula compares any signal with a number, or with another signal."""
    return any(
        constraint.op in _OPPOSITE and not isinstance(constraint.value, Limit)
        for atom in atoms(formula)
        for constraint in atom.constraints
    )


def _is_bound_by_one_signal(variable: str, body: Formula) -> bool:
    """Whether the only value of a variable that a step can show is that of one signal."""
    keys = {key for atom in atoms(body) for key, name in atom.refs if name == variable}
    return len(keys) == 1 and not any(atom.limits for atom in atoms(body))


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
