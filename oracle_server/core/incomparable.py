"""Signals that are compared and can't be: of one of them it is known that it is never a number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.comparisons import turned
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Atom, Constraint, Signal
from oracle_server.core.misfits import constraint_text, described, range_at
from oracle_server.core.places import Place, names_of, places
from oracle_server.core.spec import Spec
from oracle_server.core.typed import StreamTypes


def incomparable(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """The comparisons of signals that no event can meet, in a spec whose streams are sound."""
    where: dict[Time, list[Place]] = {}
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms:
            for constraint in atom.constraints:
                if not isinstance(constraint.value, Signal):
                    continue
                if prop.time not in where:
                    where[prop.time] = places(spec, prop.time, types)
                reason = _reason(atom, constraint, where[prop.time])
                if reason:
                    message = f"formula of '{prop.id}': {reason}"
                    yield SpecProblem(("properties", i, "formula"), message, atom.at, kind="type")


def _reason(atom: Atom, constraint: Constraint, where: Sequence[Place]) -> str:
    """Why a comparison is never met, empty where it may be."""
    possible = [p for p in where if p.allows(atom) and not p.lacks(atom)]
    for asked in (constraint, turned(constraint)):
        if possible and not any(p.range(asked.key).meets([asked]) for p in possible):
            found = f"`{asked.key}` of {names_of(possible)} is always {described(range_at(asked.key, possible))}"
            return f"`{constraint_text(constraint)}` compares numbers, and {found}; name two signals that are numbers"
    return ""
