"""The history in a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from oracle_server.core.revisions import Revision
from oracle_server.history.alone import Alone
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.forwarding import changes
from oracle_server.history.port import Done
from oracle_server.history.readers import Readers
from oracle_server.history.records import StoredStep
from oracle_server.history.sql.asking import Asking
from oracle_server.history.sql.history import SqlHistory
from oracle_server.history.sql.rows import text
from oracle_server.history.sqlite.forwarded import SqliteForwarding
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
        await super().forget_session(session)
        if self._noted:
            await self._do(session, changes.FORGET_SESSION, (session,))

    async def last_number(self) -> int:
        """The largest number that a session has, or had."""
        if not self._noted:
            return await super().last_number()
        (number,) = await self._reader.row(changes.LAST_NUMBER)
        return int(number)
