"""The history in a file that another process of this machine writes: read here, and nothing else."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from oracle_server.core.errors import HistoryError
from oracle_server.history.alone import Alone
from oracle_server.history.readers import Readers
from oracle_server.history.records import Elsewhere, OtherSession, SessionRecord
from oracle_server.history.sql.asking import Asking
from oracle_server.history.sql.history import SqlHistory
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.schema import VERSION, FormatError
from oracle_server.history.sqlite.history import NAME
from oracle_server.history.sqlite.others import IS_OPEN, OPEN, other, values
from oracle_server.history.sqlite.reader import SqliteReader, connect
from oracle_server.process.pidfile import PidFileError, running

T = TypeVar("T")

_NOBODY = "no process has its history open: it goes on once one does"


class SqliteBeside(Alone, SqlHistory):
    """A `History` that keeps nothing: every open session is at the process that writes the file."""

    def __init__(self, folder: Path) -> None:
        """Read a folder's database. Raises `HistoryError` where there is none, or none of this version's format."""
        self.path, self._folder = folder / NAME, folder
        _demand_format(self.path)

        def reader(threads: Readers, sorting: Readers) -> SqliteReader:
            return SqliteReader(self.path, threads, sorting)

        super().__init__(_ReadOnly(str(self.path)), reader, Asking(connect, str(self.path)))

    @property
    def read_only(self) -> str | None:
        """Why nothing is kept."""
        return f"this server only reads {self._folder}: what is to be judged or kept is for the process that writes it"

    async def flush(self) -> None:
        """Nothing waits to be committed."""

    async def reserve(self, name: str, number: int) -> int | None:  # noqa: ARG002 -- of a `History`
        """No session is opened here. Raises `HistoryError`."""
        raise HistoryError(str(self.read_only))

    async def tended(self) -> frozenset[int] | None:
        """The sessions of which it may delete: none."""
        return frozenset()

    async def open_sessions(self) -> list[SessionRecord]:
        """The sessions of this server that are not closed: it has none."""
        return []

    async def elsewhere(self, name: str) -> Elsewhere | None:
        """Which process has a session that is open; None where it is closed or unknown."""
        found = await self._lookups.one(tuple, IS_OPEN, (name,))
        return None if found is None else await self._place()

    async def open_elsewhere(self, name: str | None = None, origin: str | None = None) -> list[OtherSession]:
        """The sessions that are open, the newest first; or the one of a name, or a robot's."""
        others = await self._reader.all(
            partial(other, await self._place()), OPEN, values(name, origin, forwarded=False)
        )
        return [each if each.place.lasting or each.trouble else each._replace(trouble=_NOBODY) for each in others]

    async def _place(self) -> Elsewhere:
        try:
            found = await self._lookup_threads.start(partial(running, self._folder))
        except PidFileError as error:
            raise HistoryError(str(error)) from None
        if found is None:
            return Elsewhere("", None, here=False, lasting=False, beside=True)
        return Elsewhere(found.url or f"pid {found.pid}", found.url, here=False, lasting=True, beside=True)


class _ReadOnly:
    """A store that takes nothing."""

    renewal: float | None = None
    overdue: str | None = None

    def __init__(self, where: str) -> None:
        self.where = where

    def insert(self, database: Any, table: str, rows: list[Row]) -> None:
        """Insert nothing."""

    def transact(self, work: Callable[[Any], T]) -> T:  # noqa: ARG002 -- of a `Store`
        """Raise `HistoryError`."""
        raise HistoryError("it is only read here")

    def renew(self) -> None:
        """Nobody asks."""

    def reason(self, error: Exception) -> str:
        """What people are told of an error."""
        return str(error)

    def close(self) -> None:
        """There is nothing to let go of."""


def _demand_format(path: Path) -> None:
    if not path.exists():
        raise HistoryError(f"{path}: is not there yet; begin with the adapter or the server that is to write it")
    try:
        with closing(connect(str(path))) as database:
            (version,) = database.execute("PRAGMA user_version").fetchone()
    except sqlite3.Error as error:
        raise HistoryError(f"{path}: can't be read: {error}") from None
    if version > VERSION or version < 0:
        raise FormatError(version)
    if version < VERSION:
        raise HistoryError(
            f"{path}: is of an older format ({version}, not {VERSION}), and only read here; it is brought to this "
            "one by an adapter or a server of this version that writes it"
        )
