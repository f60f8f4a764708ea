"""Machines in words: what they are, and how one came to its state."""

from __future__ import annotations

from collections.abc import Callable

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.machine import Machines, Standing
from oracle_server.core.events import Signals
from oracle_server.core.machines.table import Table, possible
from oracle_server.core.naming import value_text
from oracle_server.core.nearest import listed

_WHAT = {"states": "machine of the states", "follows": "machine that follows", "sequence": "sequence"}


def machine_described(definition: Definition) -> str:
    """A machine in one line."""
    by = f" by {', '.join(definition.by)}" if definition.by else ""
    return f"{_WHAT[definition.op]} {' '.join(definition.of.split())}{by}"


def machine_told(
    definition: Definition, machines: Machines, signals: Signals, now: int, named: Callable[[int], str]
) -> str:
    """How a machine stands at a step or tick at `now` (ns); `named` names a step by its place."""
    value, table, shown = signals.get(definition.name), machines.table, machines.shown(now, signals)
    begin = f"{definition.name} {'failed' if value is None else value_text(value)}"
    if shown is None:
        return f"{begin}: {machines.lack}"
    values, standing = shown
    if values:
        begin += f" for {', '.join(f'{by} {value_text(each)}' for by, each in zip(definition.by, values, strict=True))}"
    if value is None:
        return f"{begin}: {machines.lack or _may_be(table, standing.state)}"
    if standing.state < 0 or value != table.bad:
        return f"{begin}{_since(table, standing.state, standing.event, standing.since, named)}"
    before = _since(table, standing.was, standing.was_event, standing.was_since, named)
    return f"{begin}: {_name(table, standing.was)}{before}; {_at_event(table, standing, named)}"


def _at_event(table: Table, standing: Standing, named: Callable[[int], str]) -> str:
    """The event that led to an error, and those that were allowed in its place."""
    allowed: list[str] = []
    if standing.was >= 0:
        row = table.rows[standing.was]
        bad = [state for state in row.values() if table.values[state] == table.bad]
        allowed = [
            table.events[bit.bit_length() - 1] for bit, to in row.items() if to not in bad and to != standing.was
        ]
    event = table.events[standing.event] if standing.event >= 0 else "an event"
    return f"{event} at {named(standing.since)}; allowed: {listed(allowed) or 'nothing'}"


def _since(table: Table, state: int, event: int, since: int, named: Callable[[int], str]) -> str:
    if not since:
        return " since the beginning" if state == table.start else ""
    by = f" ({table.events[event]})" if event >= 0 else ""
    return f" since {named(since)}{by}"


def _name(table: Table, state: int) -> str:
    return table.names[state] if state >= 0 else _may_be(table, state)


def _may_be(table: Table, state: int) -> str:
    names = dict.fromkeys(value or "absent" for value in table.alike(state))
    return f"an event could not be judged, so that it may be any of {listed(sorted(names)) if possible(state) else ''}"
