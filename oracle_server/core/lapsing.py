"""Scopes and conditions of sentences that are taken to last, and do not: other streams' events lack their signals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import And, Atom, Exists, Forall, Formula, Implies, Not, Or, Position, atoms, walk
from oracle_server.core.kinds import ACTION, OWN, RESERVED
from oracle_server.core.lacks import quoted, whose
from oracle_server.core.places import Place, names_of, places
from oracle_server.core.spec import Property, Spec
from oracle_server.core.typed import StreamTypes
from oracle_server.core.withholding import present


def lapsing(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about sentences of a spec without errors, whose messages have these types."""
    for i, prop in enumerate(spec.properties):
        where = [p for p in places(spec, prop.time, types) if p.stream is not None] if prop.states else []
        for state in prop.states:
            for message, at in _lapses(prop, state, where):
                yield SpecProblem(("properties", i, "formula"), message, at, severity="warning")


def _lapses(prop: Property, state: Formula, where: Sequence[Place]) -> Iterator[tuple[str, Position]]:
    """What is said of a state, once: where it is decided for want of a signal that other events have."""
    open_ = [p for p in where if present(state, p.value) is None]
    if all(_is_of_one_message(prop.formula, place) for place in open_):
        return
    for atom in atoms(state):
        lacking = [p for p in where if p not in open_ and p.allows(atom) and p.lacks(atom)]
        if open_ and lacking:
            keys = sorted({key for place in lacking for key in place.lacks(atom)})
            holds = "holds" if present(state, lacking[0].value) else "is false"
            yield (
                f"formula of '{prop.id}': `{render(state)}` is taken to last, and {holds} at every event of "
                f"{names_of(lacking)}, whatever was said last: {_mend(where, lacking, keys)}",
                atom.at,
            )
            return


def _mend(where: Sequence[Place], lacking: Sequence[Place], keys: Sequence[str]) -> str:
    """How to make a state last that reads such signals; those that actions have of their own are never held."""
    declared = {name for place in where if place.stream is not None for name in place.stream.signals or ()}
    own = [key for key in keys if key in OWN[ACTION] and key not in declared]
    if own:
        return f"{quoted(own)} can't be held: keep what it tells by a machine under `derive`"
    return whose(where, lacking, keys)


def _is_of_one_message(formula: Formula, place: Place) -> bool:
    """Whether a formula is about single messages of a stream, which have all that it reads: nothing needs to last."""
    single = all(isinstance(node, Atom | Not | And | Or | Implies | Forall | Exists) for node in walk(formula))
    keys = {c.key for atom in atoms(formula) for c in atom.constraints}
    return single and keys <= place.own.keys() | RESERVED
