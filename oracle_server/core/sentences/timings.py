"""The formulas of FRETish: when a response is asked for within a scope, from each trigger on."""

from __future__ import annotations

from oracle_server.core.formula.tree import (
    TRUE,
    Always,
    And,
    Bound,
    Eventually,
    Formula,
    Implies,
    Not,
    Or,
    Position,
    Pre,
    Since,
    Until,
)
from oracle_server.core.sentences.patterns import awaited
from oracle_server.core.sentences.scopes import Scope


def trigger(scope: Scope, condition: Formula | None, *, each: bool) -> Formula:
    """When the response is asked for: where a condition begins to hold within, or at `each` step at which it does."""
    if condition is None:
        return scope.opening
    if each:
        return scope.within(condition)
    begins: Formula = Not(Pre(condition))
    if scope.inside is not None:
        begins = Or(begins, scope.opening)
    return scope.within(And(condition, begins))


def immediately(trig: Formula, response: Formula) -> Formula:
    """At the trigger itself."""
    return Implies(trig, response)


def at_next(scope: Scope, trig: Formula, response: Formula) -> Formula:
    """At the step after the trigger, where that is within."""
    return Implies(scope.within(Pre(trig)), response)


def throughout(scope: Scope, trig: Formula, response: Formula, bound: Bound) -> Formula:
    """At the trigger and each later step of its span, within a bound."""
    if trig == scope.opening and bound.upper is None:
        return response if scope.inside is None else Implies(scope.inside, response)
    return Implies(scope.since(trig, bound), response)


def within(scope: Scope, trig: Formula, response: Formula, bound: Bound, at: Position) -> Formula:
    """At or after the trigger, within a bound, unless its span ends before."""
    met = response if scope.inside is None or scope.stays else Or(response, Not(scope.inside))
    return Implies(trig, Eventually(met, bound, at))


def after(scope: Scope, trig: Formula, response: Formula, steps: int, at: Position) -> Formula:
    """Not for so many steps, and at the one behind them, unless the span ends before."""
    then = Bound(steps + 1, steps + 1)
    if scope.inside is None or scope.stays:
        never = Always(Not(response), Bound(0, steps), at)
        return Implies(trig, And(never, Eventually(response, then, at)))
    kept = Until(And(Not(response), scope.inside), And(response, scope.inside), then, at)
    left = Until(Not(response), Not(scope.inside), Bound(0, steps + 1), at)
    return Implies(trig, Or(kept, left))


def until(scope: Scope, trig: Formula, response: Formula, stop: Formula) -> Formula:
    """From the trigger on up to the step before one that stops it, or to the end of the span."""
    going = Not(stop) if scope.inside is None else And(scope.inside, Not(stop))
    return Implies(Since(going, And(trig, Not(stop))), response)


def before(scope: Scope, trig: Formula, response: Formula, stop: Formula) -> Formula:
    """At or after the trigger, at a step before one that stops it."""
    going = Not(response) if scope.inside is None else And(scope.inside, Not(response))
    missing = Or(trig, Pre(Since(going, And(trig, Not(response)))))
    return Implies(scope.within(stop), Not(missing))


def at_last(scope: Scope, trig: Formula, response: Formula, at: Position) -> Formula:
    """At some step, at or after the trigger, of its span."""
    return Implies(trig, awaited(scope, response, Bound(), at))


def finally_(scope: Scope, trig: Formula, response: Formula) -> Formula:
    """At the last step of a span in which a trigger was."""
    left = Not(scope.inside or TRUE)
    return Implies(And(left, Pre(scope.since(trig))), Pre(response))
