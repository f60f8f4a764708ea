"""Which steps break what is asked by `always`, as a formula that looks back: also those that come after the first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import Obligation, looks_ahead
from oracle_server.core.formula.tree import Atom, Bound, Constraint, Formula, Limit, Ref, Relation


@dataclass(frozen=True, slots=True)
class Asked(tree.Once):
    """`once`, of a step at which something was asked: a step that came after a later tick counts at its time."""


Surely = Callable[[Formula], Formula]
"""What holds only where a part does, and can be judged."""


def breach(found: Obligation, surely: Surely = lambda part: part) -> Formula | None:
    """What holds at each step that breaks what some step before it asks for, or that step itself.

    An obligation is decided once, and what breaks it later is no violation any more; a guard denies that all the same.
    What can't be judged asks for nothing: parts that ask are made by `surely` what they are only where they can be.
    None where the past alone can't tell: something else than `always` waits, or one of two `always`, joined by `or`.
    """
    broken = _broken(found.goal, None if found.trigger is None else surely(found.trigger), surely)
    if broken is None:
        return None
    return reduce(lambda body, name: tree.Exists(name, body), reversed(found.variables), _bound(broken))


def unlimited(atom: Atom) -> Atom:
    """An atom that binds what this one compares with variables: it has the same match at each step."""
    limits = [Constraint(c.key, "==", Ref(_own(i))) for i, c in enumerate(atom.limits)]
    return Atom((*(c for c in atom.constraints if not isinstance(c.value, Limit)), *limits)) if limits else atom


def _bound(node: Formula) -> Formula:
    """The same formula, in which atoms bind what they compare: what looks back knows nothing else of values."""
    if not isinstance(node, Atom) or not node.limits:
        return tree.rebuilt(node, _bound)
    related: Formula = unlimited(node)
    for i, limit in enumerate(node.limits):
        assert isinstance(limit.value, Limit)  # noqa: S101 -- these are all such
        related = tree.And(related, Relation(Ref(_own(i)), limit.op, Ref(limit.value.name)))
    return reduce(lambda body, i: tree.Exists(_own(i), body), range(len(node.limits)), related)


def _own(number: int) -> str:
    """A variable's name that no text has."""
    return f"*{number}"


def _broken(goal: Formula, asked: Formula | None, surely: Surely) -> Formula | None:  # noqa: PLR0911 -- a case a node
    """What holds at each step that breaks a goal, which is asked for where a formula holds, None for everywhere."""
    match goal:
        case _ if not looks_ahead(goal):
            return _both(asked, tree.Not(goal))
        case tree.Always(operand, bound):
            return _broken(operand, _within(bound, asked), surely)
        case tree.And(left, right):
            first, second = _broken(left, asked, surely), _broken(right, asked, surely)
            return None if first is None or second is None else tree.Or(first, second)
        case tree.Implies(left, right):
            return _broken(right, _both(asked, surely(left)), surely)
        case tree.Or(left, right) if not looks_ahead(left):
            return _broken(right, _both(asked, surely(tree.Not(left))), surely)
        case tree.Or(left, right) if not looks_ahead(right):
            return _broken(left, _both(asked, surely(tree.Not(right))), surely)
        case _:
            return None


def _within(bound: Bound, asked: Formula | None) -> Formula | None:
    """Where a step at which it was asked is so far back."""
    if asked is None and not bound.lower:
        return None
    return Asked(tree.TRUE if asked is None else asked, bound)


def _both(asked: Formula | None, also: Formula) -> Formula:
    return also if asked is None else tree.And(asked, also)
