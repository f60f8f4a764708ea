"""Reading from SQLite."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

from oracle_server.history.readers import Readers
from oracle_server.history.sql.reader import Reader


def connect(path: str) -> sqlite3.Connection:
    """A connection that reads a database, whose file is there. Raises `sqlite3.Error`."""
    file = Path(path).absolute()
    alone = "&immutable=1" if _is_at_rest(file) else ""
    uri = f"{file.as_uri()}?mode=ro{alone}"  # in a URI `#`, `%` and `?` of a path have other meanings
    return sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)


def is_read_only(folder: Path) -> bool:
    """Whether it is on a file system that is mounted so, as a robot's card in another machine."""
    try:
        return bool(os.statvfs(folder).f_flag & os.ST_RDONLY)
    except OSError:
        return False


def _is_at_rest(file: Path) -> bool:
    """Whether all of a database is in its file, and nothing can be made beside it, by which SQLite would lock it.

    Raises `sqlite3.OperationalError` where what was written last is in a log that can't be read there.
    """
    log, index = (file.with_name(file.name + suffix) for suffix in ("-wal", "-shm"))
    if not is_read_only(file.parent) or (log.exists() and index.exists()):
        return False
    if log.exists() and log.stat().st_size:
        raise sqlite3.OperationalError(
            f"what was written last is in {log.name}, which can't be read on what is mounted read-only: copy the "
            "folder to a disk that can be written"
        )
    return True


class SqliteReader(Reader):
    """Reads a database's file."""

    errors = (sqlite3.Error,)

    def __init__(self, path: Path, threads: Readers, sorting: Readers | None = None) -> None:
        """Read a database, whose file is there, in some threads; put much of it in order in others, where given."""
        super().__init__(threads, sorting)
        self._path = path

    def _connect(self) -> sqlite3.Connection:
        return connect(str(self._path))
