"""Implications whose right side fails wherever their left side holds: they say no more than that it never does.

Mostly what looks back counts the very event that asks, as `not {done} since {goal}` does at an event of `done`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from itertools import islice

from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import (
    Always,
    And,
    Atom,
    Bound,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Next,
    Not,
    Once,
    Pre,
    Since,
    Until,
    atoms,
    walk,
)
from oracle_server.core.hazards.instants import Instants
from oracle_server.core.hazards.misfits import Doubt
from oracle_server.core.hazards.places import Place
from oracle_server.core.hazards.worlds import Effort

_MOST = 20
"""Most implications of a formula that are looked at."""


def excluded(
    formula: Formula, known: Instants, places: Sequence[Place], time: Time, effort: Effort, told: Set[int]
) -> Iterator[Doubt]:
    """The implications of which that can be said, but for those with parts of which something was `told`."""
    found = (node for node in walk(formula) if isinstance(node, Implies))
    for node in islice(found, _MOST):
        if told & {id(part) for part in walk(node)}:
            continue
        left, right = node.left, node.right
        if not any(True for _ in atoms(right)) or all(value is False for value in known.row(left)):
            continue
        both = And(left, right)
        if _never(both, places, effort) and not any(_never(side, places, effort) for side in (left, right)):
            one, other = render(left, time), render(right, time)
            message = f"`{other}` fails wherever `{one}` holds, so that this says no more than `not {one}`"
            message += "".join(f"; write `{render(mend, time)}` for what {when}" for mend, when in _mend(right, time))
            yield Doubt("false", both, message, _first(node), tuple(place.name for place in places))


def _never(formula: Formula, places: Sequence[Place], effort: Effort) -> bool:
    return all(value is False for value in Instants(formula, places, Place.value, effort).row(formula))


def _mend(right: Formula, time: Time) -> Iterator[tuple[Formula, str]]:
    """What asks the same of the events before, or behind, with which of both; nothing where it asks of this one."""
    before, behind = "was before that event", "comes behind that event"
    match right:
        case Since():
            yield Pre(right), before
        case Historically(operand, bound):
            yield Not(_once(operand.operand if isinstance(operand, Not) else Not(operand), bound, time)), before
        case Not(Once(operand, bound)):
            yield Not(_once(operand, bound, time)), before
        case Always() | Until():
            yield Next(right), behind


def _once(operand: Formula, bound: Bound, time: Time) -> Formula:
    """That something held at an event before."""
    if time == "steps" and bound.upper is not None:
        return Once(operand, Bound(1, bound.upper))
    return Pre(Once(operand, bound))


def _first(node: Formula) -> tuple[int, int]:
    return min(part.at for part in walk(node) if isinstance(part, Atom | Exists | Forall))
