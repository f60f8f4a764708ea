"""The history in a file that another process of this machine writes: read here, and nothing else."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from oracle_server.core.errors import HistoryError
from oracle_server.history.alone import Alone
from oracle_server.history.readers import Readers
from oracle_server.history.records import Elsewhere, OtherSession, SessionRecord
from oracle_server.history.sql.asking import Asking
from oracle_server.history.sql.history import SqlHistory
from oracle_server.history.sql.rows import Row, session_of
from oracle_server.history.sql.schema import SESSION_COLUMNS, VERSION, FormatError
from oracle_server.history.sql.standing import stands
from oracle_server.history.sqlite.history import NAME
from oracle_server.history.sqlite.reader import SqliteReader, connect
from oracle_server.process.pidfile import PidFileError, running

T = TypeVar("T")

_NOBODY = "no process has its history open: it goes on once one does"
_OPEN = (
    f"SELECT {','.join(f's.{name}' for name in SESSION_COLUMNS)}, "  # noqa: S608 -- no value is in it
    """
    coalesce(last.position, 0), coalesce(last.standing, last.outcomes), last.pending,
    (SELECT json_group_object(property, json_array(violations, first)) FROM (
        SELECT property, sum(count) AS violations, min(first) AS first FROM episodes
        WHERE session = s.number AND ord = s.decides GROUP BY property
    )),
    (SELECT json_group_array(json_array(name, attached, clock)) FROM monitors WHERE session = s.number)
FROM sessions s LEFT JOIN steps last ON last.session = s.number AND last.position = (
    SELECT position FROM steps
    WHERE session = s.number AND ord = s.decides AND revision IS NULL ORDER BY position DESC LIMIT 1
)
WHERE s.closed IS NULL AND (?1 IS NULL OR s.id = ?1) ORDER BY s.number DESC LIMIT 1000
"""
)
_IS_OPEN = "SELECT 1 FROM sessions WHERE id = ? AND closed IS NULL"

_decode = msgspec.json.decode


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
        found = await self._lookups.one(tuple, _IS_OPEN, (name,))
        return None if found is None else await self._place()

    async def open_elsewhere(self, name: str | None = None, origin: str | None = None) -> list[OtherSession]:
        """The sessions that are open, the newest first; or the one of a name. None is forwarded to here."""
        place = await self._place()
        return [] if origin is not None else await self._reader.all(partial(_other, place), _OPEN, (name,))

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


def _other(place: Elsewhere, row: Row) -> OtherSession:
    record = session_of(row[: len(SESSION_COLUMNS)])
    steps, outcomes, pending, told, them = row[-5:]
    properties = stands(record.properties, outcomes, pending, told) if steps else []
    monitors = [(name, attached > 0, clock) for name, attached, clock in _decode(them)]
    return OtherSession(record, place, steps, properties, monitors, None if place.lasting else _NOBODY)
