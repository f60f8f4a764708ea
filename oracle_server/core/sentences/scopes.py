"""When a sentence is in force: the spans of steps within which it speaks."""

from __future__ import annotations

from dataclasses import dataclass

from oracle_server.core.formula.tree import (
    ALL_PAST,
    FIRST,
    STEP,
    And,
    Bound,
    Formula,
    Implies,
    Not,
    Once,
    Pre,
    Since,
    rebuilt,
)


@dataclass(frozen=True, slots=True)
class Scope:
    """Holds `inside` at the steps within, None at all of them, and `opening` at the first one of each span.

    `stays`: what is open never closes. `begun`: it is open when the session begins, and may be over with the first
    step.
    """

    inside: Formula | None
    opening: Formula
    stays: bool = False
    begun: bool = False

    def within(self, formula: Formula) -> Formula:
        """That a formula holds, within."""
        return formula if self.inside is None else And(formula, self.inside)

    def since(self, begun: Formula, bound: Bound = ALL_PAST) -> Formula:
        """That something, which is within, has held in the span of now, at a step in a bound."""
        if self.inside is None or self.stays:
            return Once(begun, bound)
        return Since(self.inside, begun, bound)


EVERYWHERE = Scope(None, FIRST, stays=True)


def after(event: Formula) -> Scope:
    """From the first such event on."""
    return Scope(Once(event), And(event, Not(Pre(Once(event)))), stays=True)


def until(event: Formula) -> Scope:
    """From the first step on, up to the one before the first such event."""
    return Scope(Not(Once(event)), And(FIRST, Not(event)), begun=True)


def between(event: Formula, last: Formula) -> Scope:
    """From each such event on, up to the step before the next one that closes: one that is both opens."""
    inside = Since(Not(last), event)
    return Scope(inside, And(event, Not(Pre(inside))))


def during(state: Formula) -> Scope:
    """Each run of steps at which something holds."""
    return Scope(state, And(state, Not(Pre(state))))


def at_steps(formula: Formula) -> Formula:
    """That a formula holds at steps; a deadline is none, and has no events: what is not said there says nothing."""
    return Implies(STEP, formula)


def copied(formula: Formula) -> Formula:
    """A formula of which each part is an object of its own, wherever it was used."""
    return rebuilt(formula, copied)
