"""What the history asks of a database, whichever it is. Statements are written as SQLite has them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol, TypeVar

from oracle_server.history.sql.rows import Row

T = TypeVar("T")


class Cursor(Protocol):
    """The rows that a statement gives."""

    def fetchone(self) -> Any:
        """The next row, None where there is none."""
        ...

    def fetchall(self) -> list[Any]:
        """All that are left."""
        ...

    def __iter__(self) -> Iterator[Any]: ...

    def close(self) -> None:
        """End it, with rows that are left or without."""
        ...


class Database(Protocol):
    """A connection. A value that can't be kept, now or ever, is one of `batch.REFUSED`."""

    def execute(self, sql: str, values: Sequence[Any] = (), /) -> Cursor:
        """Execute a statement, whose places `?` or `?1` are for the values."""
        ...

    def executemany(self, sql: str, rows: Iterable[Sequence[Any]], /) -> object:
        """Execute a statement once for the values of each row."""
        ...

    def interrupt(self) -> None:
        """End what another thread does with it. It returns at once."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


Insert = Callable[[Any, str, list[Row]], None]
"""Inserts rows into a table of `batch.COLUMNS`, with a connection."""


class Store(Protocol):
    """The connection that alone writes, to be used in one thread."""

    where: str
    """What is written to, as people are told of it."""

    @property
    def renewal(self) -> float | None:
        """Seconds until it wants to be renewed where nothing is written; None for never."""
        ...

    @property
    def overdue(self) -> str | None:
        """Why nothing may be decided by now, whatever the writer does; None where all is well.

        For any thread but the writer's, for which it may wait.
        """
        ...

    def insert(self, database: Any, table: str, rows: list[Row], /) -> None:
        """Insert rows into a table of `batch.COLUMNS`."""
        ...

    def transact(self, work: Callable[[Any], T]) -> T:
        """Do work in a transaction, and return what it gives once that is committed.

        Where it could not be known whether the last one was, this is found out first: if it was, its result is
        returned, and the work, which must be the same, is not done again.
        """
        ...

    def renew(self) -> None:
        """Show that this server is there."""
        ...

    def reason(self, error: Exception) -> str:
        """What people are told of an error."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...
