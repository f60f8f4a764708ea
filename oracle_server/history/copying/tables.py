"""The tables that are the history, as the schema has them: their columns and keys."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from functools import cache
from typing import Any, NamedTuple

from oracle_server.history.sql.schema import DDL
from oracle_server.history.sql.statements import OF_A_SESSION

Key = Sequence[Any]
"""The values of a row's key."""


class Table(NamedTuple):
    """A table of the history, with the names of its columns, those of its key first."""

    name: str
    columns: tuple[str, ...]
    keys: int
    """How many columns its key has."""

    def reading(self, after: Key | None) -> tuple[str, tuple[Any, ...]]:
        """A statement that reads its rows by their keys, from behind one on, and its values."""
        key, values = ",".join(self.columns[: self.keys]), () if after is None else tuple(after)
        where = f"WHERE ({key}) > ({','.join('?' * self.keys)})" if values else ""
        return f"SELECT {','.join(self.columns)} FROM {self.name} {where} ORDER BY {key}", values  # noqa: S608


FORWARDED = (
    Table("origins", ("origin", "robot", "writer", "seq", "heard"), 2),
    Table(
        "forwarded",
        ("session", "origin", "robot", "number", "position", "gaps", "own", "continued", "opened", "ended"),
        1,
    ),
)
"""Of a centre: what it has of robots. Robots write to it without any server."""


@cache
def tables() -> tuple[Table, ...]:
    """All tables that have rows of sessions; the sessions first."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(DDL)
        return tuple([_table(database, name) for name, _ in reversed(OF_A_SESSION)])


def _table(database: sqlite3.Connection, name: str) -> Table:
    found = database.execute("SELECT name, pk FROM pragma_table_info(?)", (name,)).fetchall()
    key = [column for column, place in sorted(found, key=lambda each: each[1]) if place]
    return Table(name, (*key, *(column for column, place in found if not place)), len(key))
