"""A history in PostgreSQL, as one end of a copy."""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Iterator, Sequence
from typing import Any

from oracle_server.history.copying.ends import BATCH, CopyError
from oracle_server.history.copying.tables import FORWARDED, Table, tables
from oracle_server.history.postgres.connection import Connection
from oracle_server.history.postgres.schema import COUNT_ON, prepare
from oracle_server.history.sql.database import Cursor
from oracle_server.history.sql.rows import Row

_PATIENCE = 600.0
"""Seconds for an answer: tables are counted."""
_USED = "SELECT place FROM nodes WHERE until > clock_timestamp()"
_STATE = """
SELECT current_database() || ' ' || current_schema() || ' '
    || md5(coalesce((SELECT string_agg(n::text, ',' ORDER BY n::text) FROM nodes n), ''))
"""
"""A server that uses it writes its lease, by which each of its transactions can be told."""
_OWNER = """
INSERT INTO nodes (node, owner, epoch, until, batch, place) VALUES ('copy', '', 1, '-infinity', 0, 'a copy')
ON CONFLICT DO NOTHING
"""
_OWNED = """
INSERT INTO owners (session, id, node)
SELECT number, id, 'copy' FROM sessions WHERE closed IS NULL AND id NOT LIKE '%@%'
ON CONFLICT DO NOTHING
"""
"""What robots forward is theirs."""
_CAME = "SELECT session, origin, robot, number, own FROM forwarded ORDER BY session"
_BRING = """
INSERT INTO forwarded (session, origin, robot, number, position, gaps, own, opened)
SELECT number, ?2, ?3, ?4, 0, '[]', ?5, opened FROM sessions WHERE number = ?1 ON CONFLICT DO NOTHING
"""


class PostgresEnd:
    """A database that no server uses: a lease that one takes meanwhile is seen."""

    def __init__(self, url: str) -> None:
        """Connect. Raises `HistoryError` where that can't be, or a server uses it."""
        self._connection = Connection(url, "oracle-server history copy", _PATIENCE)
        info = self._connection.raw.info
        self.where = f"database {info.dbname} at {info.host or 'the local socket'}"
        try:
            self._demand_unused()
        except BaseException:
            self.close()
            raise

    def version(self) -> int:
        """The format."""
        if not self._has("format"):
            return 0
        found = self.execute("SELECT version FROM format").fetchone()
        return 0 if found is None else int(found[0])

    def tables(self) -> tuple[Table, ...]:
        """The history's, behind how far it has what robots forward: these may bring more while it is copied."""
        return (*FORWARDED, *tables()) if self._has("forwarded") else tables()

    def prepare(self) -> None:
        """Make the tables, or bring them to this version's format; see that commits are kept."""
        prepare(self._connection)

    def mark(self, version: int) -> None:
        """Set the format."""
        self.execute("UPDATE format SET version = ?", (version,))

    def state(self) -> str:
        """Its name, and what servers have written of themselves."""
        return f"PostgreSQL: {self.execute(_STATE).fetchone()[0]}"

    @contextlib.contextmanager
    def transaction(self) -> Iterator[None]:
        """Do all that is within, or nothing of it; no server makes its tables ready meanwhile."""
        self.execute("BEGIN")
        try:
            self.execute("LOCK TABLE format")  # which servers that begin look at first
            self._demand_unused()
            yield
            self._connection.commit()
        except BaseException:
            self._connection.rollback()
            raise

    def execute(self, sql: str, values: Sequence[Any] = ()) -> Cursor:
        """Execute a statement."""
        return self._connection.execute(sql, values)

    def read(self, sql: str, values: Sequence[Any]) -> Generator[list[Row], None, None]:
        """The rows that a statement gives."""
        self.execute("BEGIN READ ONLY")
        try:
            self.execute(f"DECLARE page NO SCROLL CURSOR FOR {sql}", values)
            while rows := self.execute(f"FETCH {BATCH} FROM page").fetchall():
                yield rows
        finally:
            self._connection.rollback()

    def insert(self, table: Table, rows: list[Row]) -> None:
        """Insert rows."""
        try:
            self._connection.insert(table.name, rows, table.columns)
        except ValueError as error:
            raise CopyError(f"{self.where}: refuses a row of `{table.name}`: {error}") from None

    def hand_over(self) -> None:
        """Give open sessions to a node whose lease has run out: they are taken over. Number new ones behind all."""
        self.execute(_OWNER)
        self.execute(_OWNED)
        self.execute(COUNT_ON)

    def forwarded(self) -> list[Row]:
        """Which sessions robots forward: their numbers here, the robots, and their numbers and names there."""
        return self.execute(_CAME).fetchall() if self._has("forwarded") else []

    def have_brought(self, rows: list[Row]) -> None:
        """Have those of them brought anew of which it is not known how far they are here, within a transaction."""
        for row in rows:
            self.execute(_BRING, row)

    def settle(self) -> None:
        """Have it know what the tables are like, by which it chooses how to answer."""
        for table in self.tables():
            self.execute(f"ANALYZE {table.name}")

    def close(self) -> None:
        """Let go of it."""
        self._connection.close()

    def _has(self, table: str) -> bool:
        return bool(self.execute("SELECT to_regclass(?) IS NOT NULL", (table,)).fetchone()[0])

    def _demand_unused(self) -> None:
        found = self._has("nodes") and self.execute(_USED).fetchone()
        if found:
            raise CopyError(
                f"{self.where}: a server uses it ({found[0]}); stop it, or, if it was killed, wait until its lease ends"
            )
