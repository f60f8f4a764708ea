"""The connection that alone writes to an SQLite database, in WAL mode."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Literal, TypeVar

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.sql.batch import insert_rows
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.schema import VERSION
from oracle_server.history.sqlite.migrations import demand_own, migrate

T = TypeVar("T")
Durability = Literal["full", "normal"]

log = structlog.get_logger()


class SqliteStore:
    """A file that no other process uses."""

    renewal: float | None = None
    overdue: str | None = None

    def __init__(self, path: Path, durability: Durability) -> None:
        """Open it, in this version's format. Raises `HistoryError` where it can't be used."""
        self.where, self._path = str(path), path.absolute()
        try:
            _make_private(path)
            self.database = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
            demand_own(self.database, path)
            _prepare(self.database, durability)
            self._file = path.stat()
        except OSError as error:
            raise HistoryError(f"{path}: can't be used as a database: {error.strerror}") from None
        except sqlite3.Error as error:
            raise HistoryError(f"{path}: can't be used as a database: {self.reason(error)}") from None

    def insert(self, database: sqlite3.Connection, table: str, rows: list[Row]) -> None:
        """Insert rows into a table."""
        insert_rows(database, table, rows)

    def transact(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do work in a transaction, and return what it gives once that is committed. Raises `HistoryError`."""
        self._demand_place()
        self.database.execute("BEGIN IMMEDIATE")
        try:
            result = work(self.database)
            self.database.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(sqlite3.Error):
                self.database.execute("ROLLBACK")
            raise
        return result

    def _demand_place(self) -> None:
        """Raise `HistoryError` where the file was deleted or replaced: nobody would find what is written to it."""
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(self._path.stat(), self._file):
                return
        raise HistoryError("the file was deleted, moved or replaced: put it back, or start anew")

    def renew(self) -> None:
        """Nobody asks."""

    def reason(self, error: Exception) -> str:
        """What people are told of an error."""
        if getattr(error, "sqlite_errorname", "").startswith("SQLITE_IOERR"):
            return f"{error}: the disk fails, is full, or is read-only; see the system's log"
        return str(error)

    def close(self) -> None:
        """Close the file."""
        self.database.close()


def _make_private(path: Path) -> None:
    """Let no other user read the database or what SQLite writes beside it, to which it gives the same rights."""
    os.close(os.open(path, os.O_RDONLY | os.O_CREAT | os.O_NONBLOCK, 0o600))  # a pipe would wait for who writes to it
    if not path.is_file():  # as /dev/null, whose rights would be taken from all other programs
        raise HistoryError(f"{path}: can't be used as a database: it is no file; delete it, or name another --data-dir")
    for file in (path, *(path.with_name(path.name + suffix) for suffix in ("-wal", "-shm"))):
        with contextlib.suppress(FileNotFoundError, PermissionError):  # a file of another owner
            if file.stat().st_mode & 0o077:
                file.chmod(0o600)


def _prepare(writer: sqlite3.Connection, durability: Durability) -> None:
    (pages,) = writer.execute("PRAGMA page_count").fetchone()
    writer.execute("PRAGMA journal_mode = WAL")
    writer.execute(f"PRAGMA synchronous = {durability.upper()}")
    version = migrate(writer)
    if pages and not version:
        log.warning("the history was empty; a copy of one in use lacks what is in the `history.sqlite-wal` beside it")
    if version not in (0, VERSION):
        log.info("the history was migrated to a newer format", was=version, now=VERSION)
