"""Questions to the history: verdict records by filter and cursor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from oracle_server.core.verdicts import DecisionFrame, Outcome
from oracle_server.history.sqlite.schema import LETTERS, OUTCOMES, STEP_COLUMNS, Row, records_of
from oracle_server.history.sqlite.store import Store

_PAGE = 2_000
_LAST = 2**62
"""A position behind every step."""
_COLUMNS = ",".join(STEP_COLUMNS)


@dataclass(frozen=True, slots=True)
class Query:
    """Which records are wanted; `since` and `until` bound the publication time (ns, both included).

    `after` is the `n` of the last record seen: the answer goes on behind it, in the direction of `order`.
    """

    properties: frozenset[str] = frozenset()
    outcomes: frozenset[Outcome] = frozenset()
    stream: str | None = None
    since: int | None = None
    until: int | None = None
    after: int | None = None
    limit: int = 100
    order: Literal["asc", "desc"] = "asc"
    violations: bool = False


def find(store: Store, session: int, properties: list[str], query: Query) -> tuple[list[dict[str, Any]], int | None]:
    """The records that a query asks for, and the `n` to go on after, None where there are no more."""
    found: list[dict[str, Any]] = []
    for record in _records(store, session, properties, query):
        if len(found) == query.limit:
            return found, found[-1]["n"]
        found.append(record)
    return found, None


def latest(store: Store, session: int, properties: int) -> int:
    """The `n` of a session's last committed record, 0 where there is none."""
    return (store.read("SELECT max(position) FROM steps WHERE session = ?", (session,))[0][0] or 0) * properties


def recorded_answer(store: Store, session: int, properties: list[str], monitor: str, seq: int) -> DecisionFrame | None:
    """The decision frame of an event that was asked about and is committed, None where there is none."""
    rows = store.read(
        f"SELECT {_COLUMNS} FROM steps WHERE session = ? AND monitor = ? AND seq = ? AND decision IS NOT NULL",  # noqa: S608
        (session, monitor, seq),
    )
    if not rows:
        return None
    row = dict(zip(STEP_COLUMNS, rows[0], strict=True))
    verdicts = {name: OUTCOMES[letter].value for name, letter in zip(properties, row["outcomes"], strict=True)}
    denied_by = msgspec.json.decode(row["denied_by"])
    return {"type": "decision", "seq": seq, "decision": row["decision"], "denied_by": denied_by, "verdicts": verdicts}


def _records(store: Store, session: int, properties: list[str], query: Query) -> Iterator[dict[str, Any]]:
    ascending = query.order == "asc"
    position = _start(query, len(properties))
    while rows := _steps(store, session, query, position):
        for row in rows:
            records = records_of(row, properties)
            yield from (r for r in (records if ascending else reversed(records)) if _wanted(r, query))
        position = rows[-1][STEP_COLUMNS.index("position")] + (1 if ascending else -1)


def _start(query: Query, width: int) -> int:
    """The position of the first step that can hold a wanted record."""
    if query.order == "asc":
        return 1 if query.after is None else min(query.after // width + 1, _LAST)
    return _LAST if query.after is None else min((query.after - 2) // width + 1, _LAST)


def _steps(store: Store, session: int, query: Query, position: int) -> list[Row]:
    conditions, values = ["session = ?"], [session]
    ascending = query.order == "asc"
    _add(conditions, values, "position >= ?" if ascending else "position <= ?", position)
    if query.stream is not None:
        _add(conditions, values, "stream = ?", query.stream)
    if query.since is not None:
        _add(conditions, values, "stamp >= ?", query.since)
    if query.until is not None:
        _add(conditions, values, "stamp <= ?", query.until)
    if query.violations:
        conditions.append("explanations IS NOT NULL")
    if query.outcomes:
        letters = "".join(sorted(LETTERS[o] for o in query.outcomes))
        _add(conditions, values, "outcomes GLOB ?", f"*[{letters}]*")
    direction = "ASC" if ascending else "DESC"
    where = " AND ".join(conditions)
    sql = f"SELECT {_COLUMNS} FROM steps WHERE {where} ORDER BY position {direction} LIMIT ?"  # noqa: S608
    return store.read(sql, (*values, min(_PAGE, max(query.limit, 50) + 1)))  # one more tells whether there are more


def _add(conditions: list[str], values: list[Any], condition: str, value: object) -> None:
    conditions.append(condition)
    values.append(value)


def _wanted(record: dict[str, Any], query: Query) -> bool:
    n = record["n"]
    if query.after is not None and (n <= query.after if query.order == "asc" else n >= query.after):
        return False
    if query.violations and not record["violation"]:
        return False
    if query.properties and record["property"] not in query.properties:
        return False
    return not query.outcomes or record["outcome"] in query.outcomes
