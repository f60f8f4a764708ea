"""Reads `machine:`, the name of a machine that must not be in an error, and whose states are left in time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import And, Atom, Bound, Constraint, Formula, Implies, Not, Or, Ref, Time
from oracle_server.core.machines.table import Limit
from oracle_server.core.nearest import listed, nearest
from oracle_server.core.sentences.pattern import checked
from oracle_server.core.sentences.reader import Meant

_KEY = "k"
"""The variable of the signal by which machines are told apart."""


def read_machine(text: str, derived: Mapping[str, Definition], time: Time | None) -> Meant:
    """What is asked of the machine that a text names; `time` is what the property says that its bounds count.

    Raises `FormulaError` with line and column.
    """
    name = text.strip()
    machines = [each.name for each in derived.values() if each.table is not None]
    definition = derived.get(name)
    if definition is None or definition.table is None:
        hint = nearest(name, machines)
        what = "no machine" if definition is not None else "unknown"
        there = f"there are {listed(machines)}" if machines else "`derive` has none: write `NAME: {follows: mode, …}`"
        raise FormulaError(f"'{name[:80]}' is {what}; {f'{hint} ' if hint else ''}{there}")
    limits = definition.table.limits
    timed = any(limit.within is not None for limit in limits)
    if timed and time == "steps":
        raise FormulaError(f"the states of '{name}' are left within a time: leave `time: steps` out")
    return Meant(checked(_asked(definition)), "seconds" if timed else time or "steps")


def _asked(definition: Definition) -> Formula:
    """Never in an error; and where it enters a state that has a limit, this is left again."""
    assert definition.table is not None  # noqa: S101 -- it is a machine
    limits = definition.table.limits
    if not limits:
        return Not(Atom((Constraint(definition.name, "==", definition.table.bad),)))

    key = tuple(Constraint(by, "==", Ref(_KEY)) for by in definition.by)  # one at most where there are limits

    def be(state: str) -> Atom:
        return Atom((*key, Constraint(definition.name, "==", state)))

    wrong = be(definition.table.bad)
    entries: list[Formula] = [_entered(be(limit.state), key) for limit in limits]
    trigger = reduce(Or, [*entries, wrong])
    goals: list[Formula] = [Implies(be(limit.state), _left(definition.name, limit, key)) for limit in limits]
    goal = reduce(And, [*goals, Not(wrong)])
    if not key:
        return Implies(trigger, goal)
    return tree.Forall(_KEY, Implies(And(Atom(key), trigger), goal))


def _entered(state: Atom, key: tuple[Constraint, ...]) -> Formula:
    """A machine is in a state, and was not at the step before that was one of its own."""
    before = tree.Pre(tree.Since(Not(Atom(key)), state)) if key else tree.Pre(state)
    return And(state, Not(before))


def _left(name: str, limit: Limit, key: tuple[Constraint, ...]) -> Formula:
    return tree.Eventually(Atom((*key, Constraint(name, "!=", limit.state))), Bound(0, limit.within))
