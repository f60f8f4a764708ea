"""Machines as diagrams of mermaid."""

from __future__ import annotations

import re
from collections.abc import Iterator

from oracle_server.core.derived.definition import Definition
from oracle_server.core.machines.table import Table
from oracle_server.core.units import span

_PLAIN = re.compile(r"(?!(?:end|state|note|class|direction|as)$)[A-Za-z_]\w*", re.ASCII)


def mermaid(definition: Definition) -> Iterator[str]:
    """The lines of a diagram of a machine, without what leads to an error but is not written."""
    table = definition.table
    assert table is not None  # noqa: S101 -- it is a machine
    yield "stateDiagram-v2"
    follows = definition.op == "follows"
    shown = range(len(table.events) - 1) if follows else range(len(table.names))
    ids = {i: table.names[i] if _PLAIN.fullmatch(table.names[i]) else f"s{i}" for i in shown}
    arrows = list(_arrows(table, ids, labelled=not follows))
    for i in shown:
        alone = table.values[i] == table.bad and not any(f"--> {ids[i]}" in arrow for arrow in arrows)
        if ids[i] != table.names[i] and not alone:
            yield f"    state {_quoted(table.names[i])} as {ids[i]}"
    if not follows:
        yield f"    [*] --> {ids[table.start]}"
    yield from arrows
    for limit in table.limits:
        when = "again" if limit.within is None else f"within {span(limit.within)}"
        yield f"    note right of {ids[table.names.index(limit.state)]}: to be left {when}"
    other = next((i for i in shown if table.otherwise[i] != i), None)
    if follows:
        yield f"    %% any other change is {table.bad}"
    elif other is not None:
        yield f"    %% an event that a state has not leads to {table.names[table.otherwise[other]]}"


def _arrows(table: Table, ids: dict[int, str], *, labelled: bool) -> Iterator[str]:
    for i, own in ids.items():
        for bit, to in table.rows[i].items():
            if labelled:
                yield f"    {own} --> {ids[to]}: {table.events[bit.bit_length() - 1]}"
            elif to in ids and to != i:
                yield f"    {own} --> {ids[to]}"


def _quoted(name: str) -> str:
    return '"' + re.sub(r'["\n\r#;]', " ", name) + '"'
