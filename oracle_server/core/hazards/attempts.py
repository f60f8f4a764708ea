"""What lets an event pass though it never came itself: another guard denied it, and `on_deny: keep` kept it."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.conditions import conditions
from oracle_server.core.formula.tree import Atom, Formula, Implies, Not, Once, Pre, Since, atoms, children
from oracle_server.core.judging.lingering import can_be_met
from oracle_server.core.spec import Property, Spec, StreamSpec


def attempts(spec: Spec) -> Iterator[SpecProblem]:
    """Warn of guards that let pass what comes after an event which another guard may have denied."""
    kept: dict[str, list[StreamSpec]] = {}
    for stream in spec.streams:
        if _is_kept(spec, stream):
            kept.setdefault(stream.name, []).append(stream)
    guards = {name: [prop.id for prop in spec.properties if name in prop.guards][:2] for name in kept}
    for i, prop in enumerate(spec.properties):
        plain = prop.guards and prop.external is None and not prop.numeric
        needed = tuple(_needed(prop.formula)) if plain else ()
        for name, streams in kept.items() if needed else ():
            denied_by = next((one for one in guards[name] if one != prop.id), None)
            met = (s for s in streams if any(can_be_met(spec, s, atom) for atom in needed))
            if denied_by is not None and not all(_is_answered(spec, prop, stream) for stream in met):
                message = (
                    f"property '{prop.id}' lets pass what comes after an event of {name}, which '{denied_by}' may "
                    f"deny: denied, it counts as if it had come; write `on_deny: undo` at {name}, or `on_deny: keep` "
                    "there if an attempt is enough"
                )
                yield SpecProblem(("properties", i, "guards"), message, severity="warning")


def _is_kept(spec: Spec, stream: StreamSpec) -> bool:
    """Whether what is denied of a stream counts at later steps, without a word of the spec's, and need not."""
    may_undo = stream.traits.undoable and spec.ordering.by != "both" and stream.on_unavailable == "deny"
    return may_undo and stream.action == "filter" and not stream.on_deny_given


def _is_answered(spec: Spec, prop: Property, stream: StreamSpec) -> bool:
    """Whether a property asks at what answers the events of a stream: there is no answer to one that was denied."""
    triggers = {atom for condition in conditions(prop.formula) for part in condition for atom in atoms(part)}
    answers = [other for other in spec.streams if other.name == stream.name and other is not stream]
    return any(
        can_be_met(spec, answer, atom) and not can_be_met(spec, stream, atom) for answer in answers for atom in triggers
    )


def _needed(node: Formula, *, positive: bool = True, back: bool = False) -> Iterator[Atom]:
    """The atoms that make a formula hold by what they were at earlier steps."""
    match node:
        case Atom():
            if positive and back:
                yield node
        case Not(operand):
            yield from _needed(operand, positive=not positive, back=back)
        case Implies(left, right):
            yield from _needed(left, positive=not positive, back=back)
            yield from _needed(right, positive=positive, back=back)
        case Since(_, right):
            yield from _needed(right, positive=positive, back=True)
        case _:
            for child in children(node):
                yield from _needed(child, positive=positive, back=back or isinstance(node, Once | Pre))
