"""Atoms that ask of one robot, joint or the like what is held of whichever came last."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.tree import Atom, Formula, Ref
from oracle_server.core.hazards.places import Place, names_of, places
from oracle_server.core.hazards.withholding import present
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.typed import StreamTypes


def mingled(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about formulas of a spec without errors, whose messages have these types.

    What is held has no key: at another stream's event with a `robot` of its own, it may be another robot's.
    """
    owners = {name: stream for stream in spec.streams for name in stream.hold}
    for i, prop in enumerate(spec.properties):
        bound = [a for a in prop.atoms if a.refs and any(c.key in owners for c in a.constraints)]
        where = places(spec, prop.time, types) if bound else []
        for atom in bound:
            for message in _mingled(atom, owners, [p for p in where if _matters(prop.formula, atom, p)]):
                text = f"formula of '{prop.id}': {message}"
                yield SpecProblem(("properties", i, "formula"), text, atom.at, severity="warning")


def _mingled(atom: Atom, owners: dict[str, StreamSpec], where: Sequence[Place]) -> Iterator[str]:
    """What is said of an atom, once."""
    keys = [c.key for c in atom.constraints if isinstance(c.value, Ref) and c.op == "=="]
    for held in (c.key for c in atom.constraints if c.key in owners and c.key not in keys):
        owner = owners[held]
        for key in (k for k in keys if k in (owner.signals or ())):
            others = [p for p in where if p.allows(atom) and not p.lacks(atom) and _has_its_own(p, key, held)]
            if others:
                last = f"last_{held}: {{last: {held}, by: {key}, forget: 1h}}"
                yield (
                    f"at an event of {names_of(others, 'or')} `{held}` is that of the last message of {owner.key}, "
                    f"whatever its `{key}` was; keep it by that, as `{last}` under `derive`, and ask for `last_{held}`"
                )
                return


def _matters(formula: Formula, atom: Atom, place: Place) -> bool:
    """Whether a formula may be otherwise at an event, for all that is known there, as an atom holds or not."""
    holds = present(formula, lambda a: True if a == atom else place.value(a))
    fails = present(formula, lambda a: False if a == atom else place.value(a))
    return holds is None or holds is not fails


def _has_its_own(place: Place, key: str, held: str) -> bool:
    """Whether an event has a key of its own, and beside it what is held."""
    signals = (place.stream.signals or {}) if place.stream is not None else {}
    return key in signals and held not in signals
