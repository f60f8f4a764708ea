"""What the database has of a session, for questions by time."""

from __future__ import annotations

import msgspec

from oracle_server.core.errors import UnpreparedError
from oracle_server.history.blocks import SIZE, Block, BlockRow
from oracle_server.history.records import SessionRecord
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.standing import revision_of
from oracle_server.history.timeline import Question, answer

COLUMNS = ["ord" if name == "order" else name for name in BlockRow._fields]
"""Of a step, those that blocks are made of."""
ROWS = f"SELECT {','.join(COLUMNS)} FROM steps WHERE session = ? AND position BETWEEN ? AND ? ORDER BY position"  # noqa: S608
BLOCKS = (
    "SELECT block, since, until, worst, degraded, data FROM blocks "
    "WHERE session = ? AND level = ? AND block BETWEEN ? AND ? ORDER BY block"
)
EXTENT = (
    "SELECT coalesce((SELECT min(position) FROM steps WHERE session = ?1), 1), "
    "coalesce((SELECT max(position) FROM steps WHERE session = ?1), 0), "
    "(SELECT min(block) FROM blocks WHERE session = ?1 AND level = 0), "
    "(SELECT max(block) FROM blocks WHERE session = ?1 AND level = 0)"
)
"""The first and the last position of a session's steps, and the first and the last block of level 0, NULL without."""
_REVISIONS = "SELECT revision FROM steps WHERE session = ? AND position > ? AND revision IS NOT NULL"
MOST_ROWS = 50_000
"""Rows without blocks that are read for an answer; where there are more, their blocks are being made."""


class SqliteSource:
    """A session in a database, as it is when this is made. Raises `UnpreparedError`."""

    def __init__(self, reader: Database, session: SessionRecord) -> None:
        self._reader, self._session, self.decides = reader, session.number, session.decides
        reader.execute("BEGIN")  # so that all that follows is of one commit
        found: tuple[int, int, int | None, int] = reader.execute(EXTENT, (session.number,)).fetchone()
        self.first, self.last, begin, end = found
        self.begin, self.end = (0, 0) if begin is None else (begin, end + 1)
        loose = self.last - max(self.end * SIZE, self.first - 1)
        if loose > MOST_ROWS:
            done = 100 * (self.last - self.first + 1 - loose) // (self.last - self.first + 1)
            raise UnpreparedError(
                f"session '{session.id}' was written by an older version: {done} % of its timeline is made; "
                "ask again in a minute"
            )
        sql = "SELECT EXISTS (SELECT 1 FROM monitors WHERE session = ? AND clock = 'sim')"
        self.simulated = bool(reader.execute(sql, (session.number,)).fetchone()[0])

    def blocks(self, level: int, begin: int, end: int) -> list[Block]:
        """The blocks of a level from one number to before another."""
        found = self._reader.execute(BLOCKS, (self._session, level, begin, end - 1))
        return [Block(*rest) for _, *rest in found]

    def rows(self, first: int, last: int) -> list[BlockRow]:
        """The rows from one position to another."""
        return self._reader.execute(ROWS, (self._session, first, last)).fetchall()

    def revised(self, after: int) -> int | None:
        """The first position of which rows behind another one say that something else stands."""
        found = self._reader.execute(_REVISIONS, (self._session, after)).fetchall()
        changes = [revision_of(text).changes for (text,) in found]
        return min([(c.first - 1) // len(each) + 1 for each in changes for c in each if c is not None], default=None)


def asked(reader: Database, session: SessionRecord, question: Question) -> bytes:
    """The answer to a question as JSON. Raises `UnpreparedError`."""
    return msgspec.json.encode(answer(SqliteSource(reader, session), question, session.properties))
