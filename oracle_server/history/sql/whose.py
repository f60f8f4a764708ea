"""Sessions of which something is asked: as conditions, and those that are closed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from oracle_server.history.origins import forwarded_name
from oracle_server.history.whose import Whose

Condition = tuple[str, Sequence[Any]]
"""With its values."""


def closed(whose: Whose, limit: int) -> tuple[str, list[Any]]:
    """The statement for the states of closed sessions, the newest first, with its values."""
    where, values = joined([("closed IS NOT NULL", ()), *of(whose)])
    sql = f"SELECT state, id FROM sessions WHERE {where} ORDER BY number DESC LIMIT ?"  # noqa: S608 -- no value is in it
    return sql, [*values, limit]


def of(whose: Whose, table: str = "sessions") -> list[Condition]:
    """The conditions for rows of the sessions' table, which a statement may call otherwise."""
    wanted = []
    for column, names in (("spec", whose.specs), ("id", whose.sessions)):
        if names is not None:
            wanted.append(among(f"{table}.{column}", names))
    if whose.origin is not None:
        wanted.append(_of_origin(f"{table}.id", whose.origin))
    return wanted


def among(column: str, names: Collection[str]) -> Condition:
    """The condition that a column has one of some values."""
    return (f"{column} IN ({','.join('?' * len(names))})" if names else "false", sorted(names))


def joined(wanted: Sequence[Condition]) -> tuple[str, list[Any]]:
    """All conditions as one."""
    return " AND ".join(each for each, _ in wanted) or "true", [value for _, values in wanted for value in values]


def _of_origin(column: str, origin: str) -> Condition:
    end = forwarded_name("", origin)  # LIKE takes `_` for any character, and in SQLite one case for the other
    return f"substr({column}, length({column}) - ? + 1) = ?", (len(end), end)
