"""What `check` refuses or warns of in machines, and in what formulas ask of them."""

from __future__ import annotations

import re
from collections.abc import Iterator

from oracle_server.core.atoms import canonical
from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import Any, Atom, Constraint, Formula, Limit, Position, Ref, Signal
from oracle_server.core.nearest import listed, nearest
from oracle_server.core.spec import Spec
from oracle_server.core.units import span

KeyPath = tuple[str | int, ...]


def placed(definition: Definition) -> Iterator[tuple[KeyPath, Formula, Position | None]]:
    """The formulas of a definition, each with where it stands, and where in a text that names it alone."""
    path = "derive", definition.name, definition.op
    if definition.formula is not None:
        yield path, definition.formula, None
    elif definition.table is not None:
        for i, formula in enumerate(definition.events):
            yield _named(definition, path, definition.table.events[i]), formula, _within(definition, i)


def machine_problems(definition: Definition) -> Iterator[SpecProblem]:
    """Events that are the same, so that the second never counts, and states that no event leads to."""
    table = definition.table
    assert table is not None  # noqa: S101 -- it is a machine
    path = "derive", definition.name, definition.op
    groups = [[bit.bit_length() - 1 for bit in row] for row in table.rows] if definition.op == "states" else []
    told: set[tuple[int, int]] = set()
    for events in groups or [list(range(len(table.events)))]:
        first: dict[Formula, int] = {}
        for event in events:
            other = first.setdefault(definition.events[event], event)
            if other != event and (other, event) not in told:
                told.add((other, event))
                message = (
                    f"derived signal '{definition.name}': `{table.events[event]}` is the same as "
                    f"`{table.events[other]}`, so that it never counts: only the first event that holds does"
                )
                yield SpecProblem(_named(definition, path, table.events[event]), message, _within(definition, event))
    if definition.op == "states":
        yield from _unreached(definition)
        yield from _untold(definition)
        yield from _forgotten(definition)


def never(definition: Definition, constraint: Constraint) -> str | None:
    """Why what is asked of a machine's signal never holds, None where it may."""
    table, wanted = definition.table, constraint.value
    if table is None or isinstance(wanted, Any | Ref):
        return None
    text, values = render_atom(Atom((constraint,))), list(dict.fromkeys(v for v in table.values if v is not None))
    if constraint.op not in ("==", "!=") or isinstance(wanted, Signal | Limit):
        return f"`{text}` is never met: '{definition.name}' is the state of a machine, and no number"
    if wanted in values:
        return None
    state = canonical(wanted)
    hint = f'a state is a text: write `"{state}"`;' if state in values else nearest(str(wanted), values)
    meets = "never" if constraint.op == "==" else "always"
    return f"`{text}` is {meets} met; {f'{hint} ' if hint else ''}'{definition.name}' is one of {listed(values)}"


def never_wrong(spec: Spec) -> Iterator[SpecProblem]:
    """Machines that are asked never to be in an error, to which no event leads."""
    safe = {d.name: d.table for d in spec.derive if d.table is not None and not d.table.can_err}
    for i, prop in enumerate(spec.properties):
        for atom in prop.atoms if safe else ():
            table = next((safe[c.key] for c in atom.constraints if c.key in safe and c.value == safe[c.key].bad), None)
            if table is None or (prop.says == "machine" and table.limits):
                continue
            name = next(c.key for c in atom.constraints if c.key in safe)
            state = next((value for value in table.values if value not in (None, table.bad)), "…")
            message = (
                f"formula of '{prop.id}': nothing that comes leads '{name}' to `{table.bad}`; have events that are "
                f"wrong in a state lead there, or write what must hold in a state, as in `{{{name}: {state}}} -> {{…}}`"
            )
            yield SpecProblem(("properties", i, "formula"), message, atom.at, severity="warning", kind="vacuous")


def _unreached(definition: Definition) -> Iterator[SpecProblem]:
    table = definition.table
    assert table is not None  # noqa: S101 -- it is a machine
    reached = {table.start, *(to for i, row in enumerate(table.rows) for to in row.values() if to != i)}
    reached |= {to for i, to in enumerate(table.otherwise) if to != i}
    for i, name in enumerate(table.names):
        if i not in reached and name != table.bad:
            message = (
                f"derived signal '{definition.name}': no event leads to the state '{name}': add one to another state, "
                "or leave it out"
            )
            yield SpecProblem(("derive", definition.name, "states", name), message, severity="warning")


def _untold(definition: Definition) -> Iterator[SpecProblem]:
    """A limit of the error itself, in which the machine's property is violated anyway."""
    table = definition.table
    assert table is not None  # noqa: S101 -- it is a machine
    for limit in table.limits:
        if limit.state == table.bad:
            key = "leave" if limit.within is None else "within"
            message = (
                f"derived signal '{definition.name}': `{key}` of '{table.bad}' is never told of: `machine: "
                f"{definition.name}` is violated as long as the machine is there; leave it out"
            )
            yield SpecProblem(("derive", definition.name, "states", limit.state, key), message, severity="warning")


def _forgotten(definition: Definition) -> Iterator[SpecProblem]:
    """Limits of states that a machine has left when it is forgotten, and so in its start."""
    table, life = definition.table, definition.forget
    for limit in () if table is None or life is None else table.limits:
        if life is not None and limit.within is not None and life <= limit.within:
            message = (
                f"derived signal '{definition.name}': what is forgotten after {span(life)} is in its start again, and "
                f"so has left '{limit.state}', as if in time; write a `forget` that is longer than the `within` of "
                f"{span(limit.within)}"
            )
            path = "derive", definition.name, "forget"
            yield SpecProblem(path, message, severity="warning", kind="vacuous")


def _named(definition: Definition, path: KeyPath, event: str) -> KeyPath:
    """Where an event of a machine stands first."""
    table = definition.table
    if table is None or definition.op != "states":
        return path
    bit = 1 << table.events.index(event)
    state = next(name for name, row in zip(table.names, table.rows, strict=True) if bit in row)
    return (*path, state, event)


def _within(definition: Definition, event: int) -> Position | None:
    """Where in its sequence an event stands first, None where it stands in a row."""
    if definition.table is None or definition.op != "sequence":
        return None
    name = definition.table.events[event]
    found = re.search(rf"\b{name}\b", definition.of)
    before = definition.of[: found.start()] if found else ""
    return before.count("\n") + 1, len(before) - before.rfind("\n")
