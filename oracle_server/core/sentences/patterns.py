"""The formulas of the patterns: what each says, within a scope and a bound."""

from __future__ import annotations

from oracle_server.core.formula.tree import FIRST, And, Bound, Eventually, Formula, Implies, Not, Position, Until
from oracle_server.core.sentences.scopes import Scope


def absence(scope: Scope, event: Formula, bound: Bound) -> Formula:
    """`no B within d`: no such event, within d of the opening."""
    if bound.upper is None:
        return Not(scope.within(event))
    return Not(And(event, scope.since(scope.opening, bound)))


def existence(scope: Scope, event: Formula, bound: Bound, at: Position) -> Formula:
    """`some B within d`: such an event in each span, within d of its opening.

    Where a span is open from the begin of the session on, and the first step ends it, none has come.
    """
    asks = FIRST if scope.begun else scope.opening
    return Implies(asks, awaited(scope, event, bound, at))


def response(scope: Scope, trigger: Formula, answer: Formula, bound: Bound, at: Position) -> Formula:
    """`A causes B within d`: at or after each A a B in the same span, within d."""
    return Implies(scope.within(trigger), awaited(scope, answer, bound, at))


def precedence(scope: Scope, event: Formula, before: Formula, bound: Bound) -> Formula:
    """`B requires A within d`: at or before each B an A in the same span, within d."""
    return Implies(scope.within(event), scope.since(scope.within(before), bound))


def prevention(scope: Scope, cause: Formula, event: Formula, bound: Bound) -> Formula:
    """`A forbids B within d`: at or after each A no B in the same span, within d."""
    return Implies(scope.within(event), Not(scope.since(scope.within(cause), bound)))


def universality(scope: Scope, state: Formula) -> Formula:
    """`always φ`: φ at each step within."""
    return state if scope.inside is None else Implies(scope.inside, state)


def awaited(scope: Scope, event: Formula, bound: Bound, at: Position) -> Formula:
    """An event in the span of now, at a step in a bound ahead; none is left to come once the span is over."""
    if scope.inside is None or scope.stays:
        return Eventually(event, bound, at)
    return Until(scope.inside, scope.within(event), bound, at)
