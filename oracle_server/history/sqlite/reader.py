"""Reading from SQLite."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from oracle_server.history.readers import Readers
from oracle_server.history.sql.reader import Reader


def connect(path: str) -> sqlite3.Connection:
    """A connection that reads a database, whose file is there."""
    uri = f"{Path(path).absolute().as_uri()}?mode=ro"  # in a URI `#`, `%` and `?` of a path have other meanings
    return sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)


class SqliteReader(Reader):
    """Reads a database's file."""

    errors = (sqlite3.Error,)

    def __init__(self, path: Path, threads: Readers, sorting: Readers | None = None) -> None:
        """Read a database, whose file is there, in some threads; put much of it in order in others, where given."""
        super().__init__(threads, sorting)
        self._path = path

    def _connect(self) -> sqlite3.Connection:
        return connect(str(self._path))
