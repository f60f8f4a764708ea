"""Atoms that name a service and not its kind: they hold at the request of a call, and again at its response."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import ALL_PAST, Any, Atom, Constraint, Formula, Once, children
from oracle_server.core.hazards.places import Place, places
from oracle_server.core.kinds import NAMING
from oracle_server.core.spec import Spec
from oracle_server.core.typed import StreamTypes

_SERVICE = "service"


def halves(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about a spec without errors, whose messages have these types."""
    if not any(stream.traits.group == _SERVICE for stream in spec.streams):
        return
    where = places(spec, "steps", types)
    measures = {made.name for prop in spec.properties for made in prop.measures}
    for i, prop in enumerate(spec.properties):
        formulas = [prop.formula, *(made.formula for made in prop.measures if made.formula is not None)]
        for atom in _of_both(formulas if prop.external is None else [], where):
            text = f"{prop.says} of '{prop.id}': {_told(atom)}"
            yield SpecProblem(("properties", i, "formula"), text, atom.at, severity="warning")
    for made in spec.derive:
        for atom in _of_both([made.formula] if made.formula and made.name not in measures else [], where):
            text = f"derived signal '{made.name}': {_told(atom)}"
            yield SpecProblem(("derive", made.name, made.op), text, atom.at, severity="warning")


def _told(atom: Atom) -> str:
    request, both = (
        render_atom(Atom((*atom.constraints, Constraint("kind", "==", kind)))) for kind in ("request", Any.ANY)
    )
    return (
        f"`{render_atom(atom)}` holds at the request of each call, and again at its response; write "
        f"`{request}`, or `response`, or `{both}` where both are meant"
    )


def _of_both(formulas: Sequence[Formula], where: Sequence[Place]) -> Iterator[Atom]:
    """The atoms, each once, that hold at requests and responses of one service."""
    for atom in dict.fromkeys(atom for formula in formulas for atom in _asked(formula)):
        keys = {c.key for c in atom.constraints}
        if _SERVICE in keys and "kind" not in keys:
            known = (p for p in where if not p.open or keys <= NAMING)
            kinds = {p.stream.kind for p in known if p.stream and p.allows(atom) and not p.lacks(atom)}
            if len(kinds) > 1:
                yield atom


def _asked(node: Formula) -> Iterator[Atom]:
    """The atoms of a formula, but for what is asked to have ever come: a call begins with its request."""
    if isinstance(node, Atom):
        yield node
    elif not (isinstance(node, Once) and node.bound == ALL_PAST and isinstance(node.operand, Atom)):
        for child in children(node):
            yield from _asked(child)
