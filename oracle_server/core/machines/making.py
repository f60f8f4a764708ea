"""Machines by their states, and by the values that a signal has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from oracle_server.core.machines.table import ERROR, Limit, Table

STAY = "stay"
"""What is written for a machine that takes no notice of other events."""
MAX_VALUES = 100
"""Values that a followed signal may have."""
OTHER = "another value"


def by_states(
    rows: Mapping[str, Mapping[str, str]],
    start: str,
    otherwise: str = ERROR,
    limits: Sequence[Limit] = (),
) -> Table:
    """The machine whose `rows` have for each state its events, in order, and the state that each leads to.

    All states but `error` have rows.
    """
    names = (*rows, *(() if ERROR in rows else (ERROR,)))
    places = {name: i for i, name in enumerate(names)}
    events = tuple(dict.fromkeys(event for row in rows.values() for event in row))
    bits = {event: 1 << i for i, event in enumerate(events)}
    found = tuple({bits[event]: places[to] for event, to in rows.get(name, {}).items()} for name in names)
    others = [i if otherwise == STAY or name == ERROR else places[otherwise] for i, name in enumerate(names)]
    return Table(names, names, events, found, tuple(others), places[start], limits=tuple(limits))


def by_values(successors: Mapping[str, Sequence[str]]) -> Table:
    """The machine that is where a signal is, of whose values each has `successors`; any other change is an error.

    Its event is the signal's value, the last one any that is not named. In an error it remembers the value all the
    same, and goes on from there.
    """
    values = list(successors)
    known, count = {value: i for i, value in enumerate(values)}, len(values)
    absent = 2 * count + 1
    names = (*values, *(f"{ERROR} ({each})" for each in (*values, OTHER)), "absent")
    allowed = [{known[to] for to in successors[value]} for value in values]

    def to(seen: int, event: int) -> int:
        return event if event in allowed[seen] else count + event

    rows: list[dict[int, int]] = []
    for state in range(absent):
        seen = state % count if state < 2 * count else count
        row = {1 << e: to(seen, e) if seen < count else count + e for e in range(count + 1)}
        rows.append(row | {1 << seen: state})
    rows.append({1 << e: e if e < count else 2 * count for e in range(count + 1)})
    signal = (*values, *(ERROR for _ in range(count + 1)), None)
    return Table(names, signal, (*values, OTHER), tuple(rows), tuple(range(absent + 1)), absent)
