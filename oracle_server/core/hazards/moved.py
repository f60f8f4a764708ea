"""States of machines that are asked for at the very events by which these have left them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.conditions import spine
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import And, Atom, Constraint, Formula, Implies, Not, Or, Position, Time, walk
from oracle_server.core.hazards.places import Place, places
from oracle_server.core.hazards.withholding import present
from oracle_server.core.machines.table import Table
from oracle_server.core.spec import Property, Spec
from oracle_server.core.typed import StreamTypes

_MOST = 50
"""Most conjunctions of a formula that are looked at."""


def moved_on(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about properties of a spec without errors, whose messages have these types."""
    known: dict[Time, list[Place]] = {}
    machines = [each for each in spec.derive if each.table is not None and each.op == "states"]
    for i, prop in enumerate(spec.properties if machines else ()):
        if prop.says == "machine" or prop.external or prop.numeric:
            continue
        if prop.time not in known:
            known[prop.time] = places(spec, prop.time, types)
        where = known[prop.time]
        for message, at in dict.fromkeys(_told(prop, machines, where)):
            yield SpecProblem(("properties", i, "formula"), message, at, severity="warning", kind="vacuous")


def _told(prop: Property, machines: Sequence[Definition], where: Sequence[Place]) -> Iterator[tuple[str, Position]]:
    joined = [node for node in walk(prop.formula) if isinstance(node, And | Implies | Atom)]
    for together in map(_together, joined[:_MOST]):
        constraints = {c for atom in together for c in atom.constraints}
        for machine in machines:
            for atom in together:
                state = next((c.value for c in atom.constraints if c.key == machine.name and c.op == "=="), None)
                event = None if not isinstance(state, str) else _left_by(machine, state, together, constraints, where)
                if event:
                    yield _message(prop, machine, str(state), event), atom.at


def _message(prop: Property, machine: Definition, state: str, event: str) -> str:
    asked = render_atom(Atom((Constraint(machine.name, "==", state),)))
    mend = f"write `pre {asked}` for the state before it"
    if machine.by:
        mend = f"let `{event}` lead to `error` where it must not come, and ask `machine: {machine.name}`"
    return (
        f"formula of '{prop.id}': `{asked}` never holds where `{event}` does, which has moved '{machine.name}' by "
        f"then: the state at a step is the one behind its event; {mend}"
    )


def _together(node: Formula) -> list[Atom]:
    """Atoms that hold together where a part is decided: those of an `and`, and of both sides of an implication."""
    if isinstance(node, Implies):
        right = node.right.operand if isinstance(node.right, Not) else node.right
        return [*_joined(node.left), *_joined(right)]
    return _joined(node)


def _joined(node: Formula) -> list[Atom]:
    return [part for part in spine(node) if isinstance(part, Atom)]


def _left_by(
    machine: Definition, state: str, together: Sequence[Atom], constraints: set[Constraint], where: Sequence[Place]
) -> str:
    """The event of a machine that holds with some atoms, and behind which it is never in a state; mostly empty."""
    table = machine.table
    if table is None or state not in table.values:
        return ""
    held = [_implied(event, constraints) for event in machine.events]
    if not any(held):
        return ""
    beside = [Atom(tuple(c for c in atom.constraints if c.key != machine.name)) for atom in together]
    here = [p for p in where if p.stream and all(p.value(atom) is not False for atom in beside)]
    may = [held[n] or any(present(event, p.value) is not False for p in here) for n, event in enumerate(machine.events)]
    may = [able and (held[n] or not _denied(machine.events[n], constraints)) for n, able in enumerate(may)]
    if state in _behind(table, held, may):
        return ""
    return table.events[held.index(True)]


def _behind(table: Table, held: Sequence[bool], may: Sequence[bool]) -> set[str | None]:
    """What a machine can be behind a step at which some events hold, and others may."""
    found: set[int] = set()
    for state, row in enumerate(table.rows):
        for bit, to in row.items():
            event = bit.bit_length() - 1
            found |= {to} if may[event] else set()
            if held[event]:
                break
        else:
            found.add(table.otherwise[state])
    return {table.values[state] for state in found}


def _implied(event: Formula, constraints: set[Constraint]) -> bool:
    """Whether an event holds wherever all of some constraints are met."""
    match event:
        case Atom(own):
            return bool(own) and constraints.issuperset(own)
        case And(left, right):
            return _implied(left, constraints) and _implied(right, constraints)
        case Or(left, right):
            return _implied(left, constraints) or _implied(right, constraints)
    return False


def _denied(event: Formula, constraints: set[Constraint]) -> bool:
    """Whether an event does not hold wherever they are met, since it asks for another value of a signal."""
    match event:
        case Atom(own):
            values = {c.key: c.value for c in constraints if c.op == "==" and isinstance(c.value, str | int | float)}
            return any(c.op == "==" and c.key in values and _differ(c.value, values[c.key]) for c in own)
        case And(left, right):
            return _denied(left, constraints) or _denied(right, constraints)
        case Or(left, right):
            return _denied(left, constraints) and _denied(right, constraints)
    return False


def _differ(one: object, other: object) -> bool:
    return isinstance(one, str | int | float) and (isinstance(one, bool), one) != (isinstance(other, bool), other)
