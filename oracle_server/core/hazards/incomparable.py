"""Comparisons of signals with each other, or with variables, where it is known that one of both is never a number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.comparisons import turned
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.ahead import obligation
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Atom, Constraint, Limit, Signal, atoms
from oracle_server.core.hazards.misfits import constraint_text, described, range_at
from oracle_server.core.hazards.places import Place, names_of, places
from oracle_server.core.spec import Property, Spec
from oracle_server.core.typed import StreamTypes


def incomparable(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """The comparisons that no event can meet, in a spec whose streams are sound."""
    where: dict[Time, list[Place]] = {}
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms:
            for constraint in atom.constraints:
                if not isinstance(constraint.value, Signal | Limit):
                    continue
                if prop.time not in where:
                    where[prop.time] = places(spec, prop.time, types)
                reason = _reason(atom, constraint, where[prop.time]) or _bound(prop, constraint, where[prop.time])
                if reason:
                    message = f"formula of '{prop.id}': {reason}"
                    yield SpecProblem(("properties", i, "formula"), message, atom.at, kind="type")


def _reason(atom: Atom, constraint: Constraint, where: Sequence[Place]) -> str:
    """Why a comparison is never met, empty where it may be."""
    possible = [p for p in where if p.allows(atom) and not p.lacks(atom)]
    both = (constraint, turned(constraint)) if isinstance(constraint.value, Signal) else (constraint,)
    for asked in both:
        if possible and not any(p.range(asked.key).meets([asked]) for p in possible):
            found = f"`{asked.key}` of {names_of(possible)} is always {described(range_at(asked.key, possible))}"
            mend = "name two signals that are numbers" if len(both) > 1 else "name a signal that is a number"
            return f"`{constraint_text(constraint)}` compares numbers, and {found}; {mend}"
    return ""


def _bound(prop: Property, constraint: Constraint, where: Sequence[Place]) -> str:
    """Why a comparison with a variable is never met, since what binds it is never a number; empty where it may be."""
    found = obligation(prop.formula)
    if not isinstance(constraint.value, Limit) or found is None or found.trigger is None:
        return ""
    number = Constraint("", constraint.op, constraint.value)
    for atom in atoms(found.trigger):
        for key, name in atom.refs:
            possible = [p for p in where if p.allows(atom) and not p.lacks(atom)]
            if name == constraint.value.name and possible and not any(p.range(key).meets([number]) for p in possible):
                bound = f"`{key}` of {names_of(possible)}, which '{name}' is, is always"
                text = f"`{constraint_text(constraint)}` compares numbers, and {bound}"
                return f"{text} {described(range_at(key, possible))}; bind a signal that is a number"
    return ""
