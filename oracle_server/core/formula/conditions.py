"""When a formula asks for anything: where the left side of an implication holds, or a scope is open."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from oracle_server.core.formula.tree import (
    STEP,
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
)

Condition = tuple[Formula, ...]
"""Parts that must hold together at a step for something to be asked there; none of them where it is at every step."""


def conditions(formula: Formula) -> tuple[Condition, ...]:
    """The conditions of which one must hold for a formula to ask anything, empty where it does so at every step."""
    found = tuple(_conditions(formula))
    return found if all(found) else ()


def _conditions(node: Formula) -> Iterator[Condition]:
    match node:
        case Forall(_, body) | Historically(body) | Always(body):
            yield from _conditions(body)
        case And(left, right):
            yield from _conditions(left)
            yield from _conditions(right)
        case Implies(left, right):
            yield from ((left, *more) for more in _conditions(right))
        case Or(Not(left), right) if not isinstance(right, Not):
            yield from ((left, *more) for more in _conditions(right))
        case Not(And() as both):
            yield _scopes(both)
        case _:
            yield ()


def _scopes(both: And) -> Condition:
    """Of what must not hold together the parts that look back: `no /b` within a scope asks nothing before that is."""
    parts = list(spine(both))
    scopes = tuple(part for part in parts if isinstance(part, Once | Since | Pre))
    return scopes if len(scopes) < len(parts) else ()


def spine(node: Formula) -> Iterator[Formula]:
    """The parts that are joined by `and`."""
    if isinstance(node, And):
        yield from spine(node.left)
        yield from spine(node.right)
    else:
        yield node


def may_hold(node: Formula, holds: Callable[[Atom], bool]) -> bool:
    """Whether a part may hold at a step at which just these atoms do, for some values of variables.

    What looks back or ahead may.
    """
    match node:
        case Atom():
            return holds(node)
        case Not(Atom() as atom):
            return bool(atom.variables) or not holds(atom)
        case And(left, right):
            return may_hold(left, holds) and may_hold(right, holds)
        case Or(left, right):
            return may_hold(left, holds) or may_hold(right, holds)
        case Exists(_, body):
            return may_hold(body, holds)
        case _:
            return True


def without(node: Formula, never: Callable[[Atom], bool]) -> tuple[Atom, ...]:
    """The atoms for want of which a part held at no step, where they never did; empty where it may have held."""
    match node:
        case Atom():
            return (node,) if never(node) else ()
        case And(left, right):
            return without(left, never) or without(right, never)
        case Or(left, right):
            one, other = without(left, never), without(right, never)
            return (*one, *other) if one and other else ()
        case Pre(operand) | Once(operand) | Since(_, operand):
            return without(operand, never)
        case Exists(_, body) | Forall(_, body):
            return without(body, never)
        case _:
            return ()


def needed(node: Formula) -> Iterator[Atom]:
    """The atoms for want of which a part may hold at no step."""
    match node:
        case Atom() if node not in (STEP, TRUE):
            yield node
        case And(left, right) | Or(left, right):
            yield from needed(left)
            yield from needed(right)
        case Pre(operand) | Once(operand) | Since(_, operand) | Exists(_, operand) | Forall(_, operand):
            yield from needed(operand)
