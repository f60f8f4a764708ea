"""What formulas of derived signals ask that can never hold, or always does, and states that nothing can follow."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.machinery import KeyPath, placed
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.render import render, render_atom
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Position, Scalar, atoms
from oracle_server.core.lacks import quoted, whose
from oracle_server.core.misfits import described, misfits, range_at
from oracle_server.core.places import Place, places
from oracle_server.core.signals import is_signal
from oracle_server.core.spec import Spec
from oracle_server.core.typed import StreamTypes
from oracle_server.core.withholding import present


def doubtful_derived(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about the derived signals of a spec without errors, whose messages have these types."""
    where = places(spec, "steps", types) if spec.derive else []
    for definition in spec.derive:
        for path, formula, start in placed(definition):
            for message, at in (*_doubts(formula, where), *(_repeated(formula, spec) if definition.events else ())):
                yield _warning(definition, path, message, start or at)
        if definition.op == "follows":
            yield from _unfollowed(definition, where)


def _doubts(formula: Formula, where: Sequence[Place]) -> Iterator[tuple[str, Position]]:
    """What is doubtful in a formula of one step, each with a place in its text."""
    tested = atoms(formula)
    found = [(doubt.message, doubt.at) for atom in tested for doubt in misfits(atom, where)]
    values = {present(formula, place.value) for place in where}
    if found or len(values) != 1 or None in values:
        yield from found
        return
    how = "holds at every event" if True in values else "never holds"
    message, at = f"`{render(formula)}` {how}, whatever the messages say", min(atom.at for atom in tested)
    for atom in () if True in values else tested:
        lacking = [place for place in where if place.allows(atom) and place.lacks(atom)]
        if lacking:
            keys = sorted({key for place in lacking for key in place.lacks(atom)})
            message, at = f"{message}: {whose(where, lacking, keys)}", atom.at
            break
    yield message, at


def _repeated(formula: Formula, spec: Spec) -> Iterator[tuple[str, Position]]:
    """Atoms over held signals alone, which hold again at each message: hardly what an event of a machine is."""
    for atom in atoms(formula) if len(spec.streams) > 1 else ():
        names = {c.key for c in atom.constraints}
        owner = next((s for s in spec.streams if names and names <= {*s.hold}), None)
        if owner is not None:
            kind = () if owner.traits.group == "topic" else (Constraint("kind", "==", owner.kind),)
            own = Atom((Constraint(owner.traits.group, "==", owner.name), *kind, *atom.constraints))
            text = render_atom(atom)
            message = (
                f"`{text}` holds at the messages of all streams, since {quoted(sorted(names))} of {owner.key} "
                f"{'is' if len(names) == 1 else 'are'} held, so that the event comes again at each of them; write "
                f"`{render_atom(own)}` if it is one of {owner.key} alone"
            )
            yield message, atom.at


def _unfollowed(definition: Definition, where: Sequence[Place]) -> Iterator[SpecProblem]:
    """States of a machine that no value of the signal is which it follows."""
    table = definition.table
    having = [place for place in where if place.has(definition.of)]
    found = range_at(definition.of, having)
    for state in dict.fromkeys(value for value in table.values if value not in (None, table.bad)) if table else ():
        assert state is not None  # noqa: S101 -- such are left out
        if having and not any(found.meets([Constraint(definition.of, "==", value)]) for value in _written_as(state)):
            message = f"no value of `{definition.of}` is the state '{state}': it is always {described(found)}"
            yield _warning(definition, ("derive", definition.name, "states", state), message, None)


def _written_as(state: str) -> Iterator[Scalar]:
    """The values that are written as a state's name."""
    yield state
    with suppress(ValueError):
        value = json.loads(state)
        if is_signal(value):
            yield value


def _warning(definition: Definition, path: KeyPath, message: str, at: Position | None) -> SpecProblem:
    text = f"derived signal '{definition.name}': {message}"
    return SpecProblem(path, text, at, severity="warning", kind="vacuous")
