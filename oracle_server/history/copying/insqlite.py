"""A history in a file, as one end of a copy."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Any

from oracle_server.core.errors import HistoryError
from oracle_server.history.copying.ends import BATCH, CopyError
from oracle_server.history.copying.tables import Table, tables
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.schema import VERSION
from oracle_server.history.sql.statements import insertion
from oracle_server.history.sqlite.history import NAME
from oracle_server.history.sqlite.reader import connect, is_read_only
from oracle_server.history.sqlite.store import SqliteStore
from oracle_server.process.pidfile import PidFile, PidFileError, running


def file_of(text: str) -> Path:
    """The file that is named: itself, or that of a data directory."""
    path = Path(text)
    return path if path.is_file() or (path.suffix == ".sqlite" and not path.is_dir()) else path / NAME


def _held(folder: Path, *, source: bool) -> PidFile | None:
    """The lock on a data directory, so that no server begins with it; None where none can be had, as nobody can write.

    Raises `PidFileError` where a server uses it: one elsewhere can, too, where only this view of it is read-only.
    """
    if not (source and is_read_only(folder)):
        return PidFile(folder)
    server = running(folder)
    if server is not None:
        raise PidFileError(f"{folder}: a server uses this data directory (pid {server.pid}, where it runs); stop it")
    return None


class SqliteEnd:
    """A file, held so that no server uses it meanwhile."""

    def __init__(self, text: str, *, source: bool) -> None:
        """Open a file, or that of a data directory; a `source` must be there, and is only read.

        Raises `HistoryError` where it can't be used, `PidFileError` where a server uses it.
        """
        self._path = file_of(text)
        self.where = str(self._path)
        if source and not self._path.is_file():
            raise CopyError(f"{self.where}: there is no history; name a data directory, its file, or postgresql://…")
        self._held = _held(self._path.parent, source=source) if self._path.name == NAME else None
        try:
            with self._told():
                self._database = connect(self.where) if source else sqlite3.connect(self._path, isolation_level=None)
        except BaseException:
            self._release()
            raise

    def version(self) -> int:
        """The file's format. Raises `CopyError` where it is another database."""
        (version,) = self.execute("PRAGMA user_version").fetchone()
        if not version and self.execute("SELECT 1 FROM sqlite_master").fetchone():
            raise CopyError(f"{self.where}: is a database, and no history")
        return int(version)

    def tables(self) -> tuple[Table, ...]:
        """The history's."""
        return tables()

    def prepare(self) -> None:
        """Make the tables, in a file that nobody else can read, or bring them to this version's format."""
        if self.version() < VERSION:
            SqliteStore(self._path, "full").close()

    def mark(self, version: int) -> None:
        """Set the format."""
        self.execute(f"PRAGMA user_version = {version}")

    def state(self) -> str:
        """When it was written last, and its size; its log's, too: that of a server that was killed stays."""
        files = (self._path, self._path.with_name(f"{self._path.name}-wal"))
        told = [f"{s.st_size} bytes of {s.st_mtime_ns}" for s in (file.stat() for file in files if file.exists())]
        return "SQLite: " + ", ".join(each for each in told if not each.startswith("0 "))

    @contextlib.contextmanager
    def transaction(self) -> Iterator[None]:
        """Do all that is within, or nothing of it."""
        self.execute("BEGIN IMMEDIATE")
        try:
            yield
            self.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(HistoryError):
                self.execute("ROLLBACK")
            raise

    def execute(self, sql: str, values: Sequence[Any] = ()) -> sqlite3.Cursor:
        """Execute a statement."""
        with self._told():
            return self._database.execute(sql, values)

    def read(self, sql: str, values: Sequence[Any]) -> Generator[list[Row], None, None]:
        """The rows that a statement gives."""
        with contextlib.closing(self.execute(sql, values)) as cursor, self._told():
            while rows := cursor.fetchmany(BATCH):
                yield rows

    def insert(self, table: Table, rows: list[Row]) -> None:
        """Insert rows."""
        with self._told():
            self._database.executemany(insertion(table.name, table.columns), rows)

    def hand_over(self) -> None:
        """There is one server at the most: all sessions are its own."""

    def forwarded(self) -> list[Row]:
        """Which sessions robots forward: none to a file."""
        return []

    def have_brought(self, rows: list[Row]) -> None:
        """Nothing can be brought to a file."""

    def settle(self) -> None:
        """Nothing is to be done."""

    def close(self) -> None:
        """Let go of it."""
        self._database.close()
        self._release()

    def _release(self) -> None:
        if self._held is not None:
            self._held.release()

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise HistoryError(f"{self.where}: {error}") from None
