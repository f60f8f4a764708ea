"""What a copy asks of the database at either end."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

from oracle_server.core.errors import HistoryError
from oracle_server.history.copying.tables import Table
from oracle_server.history.sql.database import Cursor
from oracle_server.history.sql.rows import Row

BATCH = 64
"""Rows that are read at once: each may have a megabyte."""


class End(Protocol):
    """A database that no server uses. All of it raises `HistoryError`."""

    where: str
    """What it is, as people are told of it."""

    def version(self) -> int:
        """Its format, 0 where it has none yet."""
        ...

    def tables(self) -> tuple[Table, ...]:
        """The tables that it has of a history, in the sequence in which they are copied."""
        ...

    def prepare(self) -> None:
        """Make the tables, or bring them to this version's format. Raises `FormatError` of a newer one."""
        ...

    def mark(self, version: int) -> None:
        """Set its format, within a transaction."""
        ...

    def state(self) -> str:
        """What tells it from other histories, and from itself once a server has used it."""
        ...

    def transaction(self) -> AbstractContextManager[object]:
        """Do all that is within, or nothing of it; nobody else begins to write meanwhile."""
        ...

    def execute(self, sql: str, values: Sequence[Any] = ()) -> Cursor:
        """Execute a statement, which is written as SQLite has it."""
        ...

    def read(self, sql: str, values: Sequence[Any]) -> Generator[list[Row], None, None]:
        """The rows that a statement gives, `BATCH` at a time; those that are not wanted yet take no memory."""
        ...

    def insert(self, table: Table, rows: list[Row]) -> None:
        """Insert rows, within a transaction."""
        ...

    def hand_over(self) -> None:
        """Let whichever server begins first go on with the sessions that are open, within a transaction."""
        ...

    def forwarded(self) -> list[Row]:
        """Which sessions robots forward: their numbers here, the robots' origins and histories, their numbers there."""
        ...

    def have_brought(self, rows: list[Row]) -> None:
        """Have those of them brought anew of which it is not known how far they are here, within a transaction."""
        ...

    def settle(self) -> None:
        """Make it ready for questions, once all is there."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


class CopyError(HistoryError):
    """A history that can't be copied, or not to where it was to go."""
