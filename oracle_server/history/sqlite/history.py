"""The history in a file."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from oracle_server.core.revisions import Revision
from oracle_server.history.alone import Alone
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.forwarding import changes
from oracle_server.history.origins import origin_of
from oracle_server.history.port import Done
from oracle_server.history.readers import Readers
from oracle_server.history.records import Elsewhere, OtherSession, StoredStep
from oracle_server.history.sql.asking import Asking
from oracle_server.history.sql.history import SqlHistory
from oracle_server.history.sql.rows import text
from oracle_server.history.sqlite.forwarded import SqliteForwarding
from oracle_server.history.sqlite.others import IS_OPEN, OPEN, other, values
from oracle_server.history.sqlite.reader import SqliteReader, connect
from oracle_server.history.sqlite.store import Durability, SqliteStore

NAME = "history.sqlite"
"""The file in a data directory."""


class SqliteHistory(Alone, SqlHistory):
    """A `History` in one file, for one process."""

    def __init__(self, folder: Path, durability: Durability = "full", *, forwarding: bool = False) -> None:
        """Open a folder's database, which must be nobody else's. Raises `HistoryError` where it can't be used.

        What changes is noted for its `forwarding`, now and whenever it is opened later.
        """
        self.path = folder / NAME

        def reader(threads: Readers, sorting: Readers) -> SqliteReader:
            return SqliteReader(self.path, threads, sorting)

        self.store = SqliteStore(self.path, durability)
        super().__init__(self.store, reader, Asking(connect, str(self.path)))
        self._noted = forwarding or self.store.database.execute(changes.IS_NOTED).fetchone() is not None
        if self._noted:
            self.store.transact(changes.begin)
        self.forwarding = SqliteForwarding(str(self.path), self._writer, self._lookups) if forwarding else None

    def append(
        self, session: int, steps: Sequence[StoredStep], done: Done, revisions: Sequence[Revision] = (),
        episodes: Sequence[StoredEpisode] = (),
    ) -> None:  # fmt: skip
        """Keep steps that were judged, what stands of earlier ones, and episodes."""
        gone = [(session, each.property, each.episode.first) for each in episodes if self._noted and each.gone]
        for sql in changes.NOTE_GONE if gone else ():
            self._execute(session, sql, lambda: (text(gone),))
        super().append(session, steps, done, revisions, episodes)

    async def forget_session(self, session: int) -> None:
        """Delete all that is left of a session."""
        if self._noted:
            self._execute(session, changes.FORGET_SESSION, lambda: (session,), needed=False, always=True)
        await super().forget_session(session)

    async def elsewhere(self, name: str) -> Elsewhere | None:
        """The robot that has a session which is open; None of any that is this server's, closed or unknown."""
        if (origin := origin_of(name)) is None or await self._lookups.one(tuple, IS_OPEN, (name,)) is None:
            return None
        return Elsewhere(origin, None, here=False, lasting=False)

    async def open_elsewhere(self, name: str | None = None, origin: str | None = None) -> list[OtherSession]:
        """The open sessions that a centre's history, from which this one is copied, had of robots."""
        return await self._reader.all(partial(other, None), OPEN, values(name, origin, forwarded=True))

    async def last_number(self) -> int:
        """The largest number that a session has, or had."""
        if not self._noted:
            return await super().last_number()
        (number,) = await self._reader.row(changes.LAST_NUMBER)
        return int(number)
