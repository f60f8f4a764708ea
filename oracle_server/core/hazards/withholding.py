"""Whether a property that an event breaks holds again once the event is withheld."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from oracle_server.core.derived.lacking import lacking
from oracle_server.core.formula.ahead import Ahead, Obligation, obligation
from oracle_server.core.formula.tree import (
    TRUE,
    Always,
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
    walk,
)
from oracle_server.core.plan import can_meet
from oracle_server.core.spec import Property, Spec


def lasting(spec: Spec, carried: Iterable[str] = ()) -> frozenset[str]:
    """The signals that a step may have which has none of its own, but those that it is `carried` by."""
    holds = frozenset(carried).union(*(stream.hold for stream in spec.streams))
    return (spec.kept | holds) - lacking(spec.derive, holds.__contains__).keys()


def without_signals(kept: frozenset[str]) -> Callable[[Atom], bool | None]:
    """What is known of atoms at a step that has no signals but some of those that are `kept`."""
    return lambda atom: True if atom == TRUE else None if all(c.key in kept for c in atom.constraints) else False


def stays(formula: Formula, kept: frozenset[str]) -> bool:
    """Whether a formula is one of a state, by signals that are `kept`: it comes again at each step while it holds."""
    is_state = all(isinstance(node, Atom | Not | And | Or | Implies) for node in walk(formula))
    return is_state and present(formula, without_signals(kept)) is None


def mendable(spec: Spec, prop: Property, name: str) -> bool:
    """Whether the property always holds at a step without signals, or never fails at an event of the stream."""
    quiet = without_signals(lasting(spec))
    named = [s for s in spec.streams if s.name == name]
    own = [s for s in named if s.action == "filter"] or named

    def at_event(atom: Atom) -> bool | None:
        if atom == TRUE:
            return True
        return None if any(can_meet(s, atom) for s in own) else False

    found = obligation(prop.formula)
    if found is not None:
        return _owes(found, quiet) is True or _owes(found, at_event) is True
    return present(prop.formula, quiet) is True or present(prop.formula, at_event) is True


def _owes(found: Obligation, atom: Callable[[Atom], bool | None]) -> bool | None:
    """Whether no obligation is decided false now, whenever it was opened."""
    return _and_all(
        present(node.operand, atom) if isinstance(node, Always) else None
        for node in walk(found.goal)
        if isinstance(node, Ahead)
    )


def _and_all(values: Iterable[bool | None]) -> bool | None:
    known: bool | None = True
    for value in values:
        known = _and(known, value)
    return known


def present(node: Formula, atom: Callable[[Atom], bool | None]) -> bool | None:  # noqa: C901, PLR0911
    """Whether a formula holds now whatever the past was: Kleene's logic over what is known of its atoms now."""
    match node:
        case Atom():
            return atom(node)
        case Not(operand):
            return _not(present(operand, atom))
        case And(left, right):
            return _and(present(left, atom), present(right, atom))
        case Or(left, right):
            return _or(present(left, atom), present(right, atom))
        case Implies(left, right):
            return _or(_not(present(left, atom)), present(right, atom))
        case Pre():
            return None
        case Once(operand, bound):
            return True if bound.lower == 0 and present(operand, atom) else None
        case Historically(operand, bound):
            return False if bound.lower == 0 and present(operand, atom) is False else None
        case Since(left, right, bound):
            if bound.lower == 0 and present(right, atom):
                return True
            missing = bound.lower > 0 or present(right, atom) is False
            return False if missing and present(left, atom) is False else None
        case Exists(_, body) | Forall(_, body):
            return present(body, atom)
        case _:
            return None


def _not(value: bool | None) -> bool | None:
    return None if value is None else not value


def _and(left: bool | None, right: bool | None) -> bool | None:
    if left is False or right is False:
        return False
    return None if left is None or right is None else True


def _or(left: bool | None, right: bool | None) -> bool | None:
    return _not(_and(_not(left), _not(right)))
