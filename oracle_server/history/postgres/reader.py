"""Reading from PostgreSQL: with connections that are kept for the next query."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

from oracle_server.core.errors import HistoryError
from oracle_server.history.postgres.connection import Connection
from oracle_server.history.readers import Readers
from oracle_server.history.sql.database import Cursor, Database
from oracle_server.history.sql.reader import Reader, Values

_NAME = "oracle-server reader"
_PATIENCE = 120.0
"""Seconds for an answer: a long trace is put in order in some ten."""
_BEGIN = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"
"""All that follows is of one commit, as it is in SQLite."""


def connect(url: str) -> Lent:
    """A connection, which is kept for the next time. Raises `HistoryError`."""
    return _pool(url).lend()


@lru_cache(1)
def _pool(url: str) -> Pool:
    return Pool(url, 1)


class Pool:
    """Connections of which each is used by one thread at a time."""

    def __init__(self, url: str, most: int) -> None:
        """Keep some connections at the most that nobody uses."""
        self._url, self._most = url, most
        self._free: deque[Connection] = deque()
        self._lock = threading.Lock()
        self._closed = False

    def lend(self) -> Lent:
        """A connection, until it is closed. Raises `HistoryError`."""
        with self._lock:
            while self._free:
                connection = self._free.pop()
                if not connection.ended:
                    return Lent(connection, self)
                connection.close()
        return Lent(Connection(self._url, _NAME, _PATIENCE), self)

    def take_back(self, connection: Connection) -> None:
        """Keep a connection for the next one, or close it."""
        with self._lock:
            if not connection.lost and not self._closed and len(self._free) < self._most:
                self._free.append(connection)
                return
        connection.close()

    def close(self) -> None:
        """Close all."""
        with self._lock:
            self._closed = True
            while self._free:
                self._free.pop().close()


class Lent:
    """A connection, for as long as one query has it."""

    def __init__(self, connection: Connection, pool: Pool) -> None:
        self._connection: Connection | None = connection
        self._pool, self._lock = pool, threading.Lock()
        self._begun = self._kept = False

    def execute(self, sql: str, values: Sequence[Any] = (), /) -> Cursor:
        """Execute a statement."""
        if sql == "BEGIN":
            self._begun, sql = True, _BEGIN
        return self._own().execute(sql, values)

    def executemany(self, sql: str, rows: Iterable[Sequence[Any]], /) -> None:
        """Execute a statement once for the values of each row."""
        self._own().executemany(sql, rows)

    def interrupt(self) -> None:
        """End what another thread reads with it."""
        with self._lock:
            if self._connection is not None:
                self._connection.interrupt()

    def close(self) -> None:
        """Give it back."""
        with self._lock:
            connection, self._connection = self._connection, None
        if connection is not None:
            if self._begun:
                connection.rollback()
            self._pool.take_back(connection)

    def _own(self) -> Connection:
        if self._connection is None:
            raise HistoryError("the reading has ended")
        return self._connection


class PostgresReader(Reader):
    """Reads a database."""

    def __init__(self, pool: Pool, threads: Readers, sorting: Readers | None = None) -> None:
        """Read with a pool's connections in some threads; put much in order in others, where given."""
        super().__init__(threads, sorting)
        self._pool = pool

    def _connect(self) -> Database:
        return self._pool.lend()

    def _sort(self, reader: Database, order: str, values: Values) -> None:
        reader.execute("DROP TABLE IF EXISTS sorted")
        reader.execute(
            "CREATE TEMP TABLE sorted (rowid BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY, "
            "session BIGINT, position BIGINT)"
        )
        reader.execute(f"INSERT INTO sorted (session, position) {order}", values)
