"""How long an event may matter to a property: at its own step alone, or at later ones too, where it stays."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from oracle_server.core.formula.ahead import obligation
from oracle_server.core.formula.breach import breach
from oracle_server.core.formula.tree import Atom, Formula, Historically, Once, Pre, Since, children
from oracle_server.core.plan import can_meet, reserved_of
from oracle_server.core.spec import Property, Spec, StreamSpec


class Trace(Enum):
    """What a stream's events leave behind for a property."""

    NONE = "none"
    """Nothing: what an event was plays no part at later steps."""
    ATOMS = "atoms"
    """Its formula looks back at atoms that they can meet: an event that meets no other than silence does adds nothing.
    """
    SIGNALS = "signals"
    """It reads signals that they leave behind, held or derived: each of them may add to these."""


def trace(spec: Spec, prop: Property, stream: StreamSpec) -> Trace:
    """What the stream's events leave behind for a property, which the native engine judges."""
    if prop.external is not None or prop.numeric:
        return Trace.NONE
    left = left_by(spec, stream)
    if any(c.key in left for atom in prop.atoms for c in atom.constraints):
        return Trace.SIGNALS
    found = obligation(prop.formula)
    broken = prop.formula if found is None else breach(found)
    atoms = prop.atoms if broken is None else _looked_back_at(broken)
    return Trace.ATOMS if any(can_be_met(spec, stream, atom) for atom in atoms) else Trace.NONE


def left_by(spec: Spec, stream: StreamSpec) -> frozenset[str]:
    """The held and the derived signals that a stream's events change."""
    found = set(stream.hold)
    for definition in spec.derive:  # each reads none but those before it
        reads = {c.key for atom in definition.atoms for c in atom.constraints}
        if reads & found or any(can_be_met(spec, stream, atom) for atom in definition.atoms):
            found.add(definition.name)
    return frozenset(found)


def lingers(spec: Spec, prop: Property, name: str) -> bool:
    """Whether a denied event of a filtered stream of this name may count at later steps, since it has happened."""
    named = [s for s in spec.streams if s.name == name and s.action == "filter"]
    kept = [s for s in named if not (s.on_deny == "undo" and s.traits.undoable)]
    return any(trace(spec, prop, s) is not Trace.NONE for s in kept)


def can_be_met(spec: Spec, stream: StreamSpec, atom: Atom) -> bool:
    """Whether an event of a stream can meet an atom, and not by what others have left alone."""
    own = None if stream.signals is None else stream.signals.keys() | reserved_of(stream)
    keys = {c.key for c in atom.constraints}
    if own is not None and (not keys <= own | spec.kept or (keys and keys.isdisjoint(own))):
        return False
    return can_meet(stream, atom)


def _looked_back_at(formula: Formula, *, within: bool = False) -> Iterator[Atom]:
    """The atoms whose truth at a step counts at later ones."""
    if isinstance(formula, Atom) and within:
        yield formula
    within = within or isinstance(formula, Pre | Once | Historically | Since)
    for child in children(formula):
        yield from _looked_back_at(child, within=within)
