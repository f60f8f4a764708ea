"""Names of signals that stand in atoms as texts: `{speed == limit}` compares with the text, and not with the signal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.tree import Atom, Constraint
from oracle_server.core.kinds import NAMING
from oracle_server.core.misfits import constraint_text, range_at
from oracle_server.core.places import Place, places
from oracle_server.core.spec import Spec
from oracle_server.core.typed import StreamTypes


def namesakes(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about formulas of a spec without errors, whose messages have these types."""
    names = named(spec)
    for i, prop in enumerate(spec.properties):
        if any(c.bare and c.value in names for atom in prop.atoms for c in atom.constraints):
            where = places(spec, prop.time, types)
            for atom in prop.atoms:
                for message in namesake(atom, names, where):
                    text = f"formula of '{prop.id}': {message}"
                    yield SpecProblem(("properties", i, "formula"), text, atom.at, severity="warning")


def named(spec: Spec) -> frozenset[str]:
    """The names of all signals that a spec declares or derives."""
    declared = frozenset[str]().union(*(stream.signals or () for stream in spec.streams))
    return declared.union(definition.name for definition in spec.derive)


def namesake(atom: Atom, names: Set[str], where: Sequence[Place]) -> Iterator[str]:
    """What is said of the texts in an atom that are written without quotes, and that are names of signals.

    Nothing where the signal is known to have such a text, or no value in common with the other one.
    """
    for constraint in atom.constraints:
        key, name = constraint.key, constraint.value
        if not (constraint.bare and isinstance(name, str) and name in names - {key}) or key in NAMING:
            continue
        found = range_at(key, [p for p in where if p.allows(atom) and not p.lacks(atom)])
        if name in found.values or not found.overlaps(range_at(name, [p for p in where if p.has(name)])):
            continue
        yield (
            f'`{_written(constraint)}` asks for the text "{name}", and not for the value of the signal `{name}`; put '
            f"the text in quotes if it is meant, and compare the signals by a third one, as `same: {key} == {name}` "
            "under `derive`, if not"
        )


def _written(constraint: Constraint) -> str:
    return constraint_text(constraint).replace('"', "")
