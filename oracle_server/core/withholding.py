"""Whether a property that an event breaks holds again once the event is withheld."""

from __future__ import annotations

from collections.abc import Callable

from oracle_server.core.formula.tree import (
    TRUE,
    And,
    Atom,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Pre,
    Since,
)
from oracle_server.core.plan import can_meet
from oracle_server.core.spec import Property, Spec


def mendable(spec: Spec, prop: Property, name: str) -> bool:
    """Whether the property always holds at a step without signals, or never fails at an event of the stream."""
    held = spec.kept
    own = [s for s in spec.streams if s.name == name]

    def quiet(atom: Atom) -> bool | None:
        if atom == TRUE:
            return True
        return None if all(c.key in held for c in atom.constraints) else False

    def at_event(atom: Atom) -> bool | None:
        if atom == TRUE:
            return True
        return None if any(can_meet(s, atom) for s in own) else False

    return _present(prop.formula, quiet) is True or _present(prop.formula, at_event) is True


def _present(node: Formula, atom: Callable[[Atom], bool | None]) -> bool | None:  # noqa: C901, PLR0911
    """Whether a formula holds now whatever the past was: Kleene's logic over what is known of its atoms now."""
    match node:
        case Atom():
            return atom(node)
        case Not(operand):
            return _not(_present(operand, atom))
        case And(left, right):
            return _and(_present(left, atom), _present(right, atom))
        case Or(left, right):
            return _or(_present(left, atom), _present(right, atom))
        case Implies(left, right):
            return _or(_not(_present(left, atom)), _present(right, atom))
        case Pre():
            return None
        case Once(operand, bound):
            return True if bound.lower == 0 and _present(operand, atom) else None
        case Historically(operand, bound):
            return False if bound.lower == 0 and _present(operand, atom) is False else None
        case Since(left, right, bound):
            if bound.lower == 0 and _present(right, atom):
                return True
            missing = bound.lower > 0 or _present(right, atom) is False
            return False if missing and _present(left, atom) is False else None
        case Exists(_, body) | Forall(_, body):
            return _present(body, atom)


def _not(value: bool | None) -> bool | None:
    return None if value is None else not value


def _and(left: bool | None, right: bool | None) -> bool | None:
    if left is False or right is False:
        return False
    return None if left is None or right is None else True


def _or(left: bool | None, right: bool | None) -> bool | None:
    return _not(_and(_not(left), _not(right)))
