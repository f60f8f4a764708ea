"""What a robot's history has that the centre does not: read in one transaction, so that it belongs together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from oracle_server.history.copying.ends import BATCH
from oracle_server.history.copying.tables import Table, tables
from oracle_server.history.forwarding.changes import GONE
from oracle_server.history.sql.rows import Row
from oracle_server.history.sqlite.reader import connect

CHARACTERS = 4_000_000
"""A chunk has hardly more text than that."""
BY_NAME = {table.name: table for table in tables()}
_EXTENTS = """
SELECT s.number, coalesce((SELECT min(position) FROM steps WHERE session = s.number), 1),
    coalesce((SELECT max(position) FROM steps WHERE session = s.number), 0)
FROM sessions s ORDER BY s.number
"""
_NOTED = "SELECT coalesce((SELECT position FROM forwarded WHERE session = ?), 0)"
"""Up to where its steps are known to be at the centre: retention may have deleted all of these."""
_LAST = "SELECT coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'changes'), 0)"
_CHANGES = "SELECT seq, name, session, a, b FROM changes WHERE seq > ? ORDER BY seq LIMIT ?"
_OPENED = "SELECT opened FROM sessions WHERE number = ?"
_COMING = (
    "SELECT number FROM sessions WHERE closed IS NULL UNION SELECT session FROM changes WHERE name = ? AND seq > ?"
)
_JUDGED = "SELECT judged FROM steps WHERE session = ? AND position = ?"
_EPISODES = BY_NAME["episodes"]
_BEGUN_IN = f"""
SELECT {",".join(f"e.{name}" for name in _EPISODES.columns)}
FROM sessions s CROSS JOIN json_each(s.properties) p CROSS JOIN episodes e
WHERE s.number = ?1 AND e.session = s.number AND e.property = p.value AND e.first
    BETWEEN (?2 - 1) * json_array_length(s.properties) + 1 AND ?3 * json_array_length(s.properties)
"""  # noqa: S608 -- no value is in it
"""By their key: a session may have more of them than a chunk has rows, and each chunk asks."""


class Page(NamedTuple):
    """Steps of a session, one behind the other; `first` is the first position that it has at all."""

    session: int
    first: int
    rows: list[Row]


class Change(NamedTuple):
    """A row of a table as it is now, by its key; None where an episode was taken back."""

    table: str
    key: tuple[Any, ...]
    row: Row | None


class Known(NamedTuple):
    """What the centre has of a session: when it was opened, and its last step with the time that it was judged (ns)."""

    opened: int | None
    position: int
    judged: int | None


@dataclass
class Chunk:
    """What is brought together. `sessions` are the rows of those that the centre does not have.

    `coming` are the sessions whose end is still to come.

    Episodes come with the step at which they begin, too: until what has changed is there, behind the steps of a
    backlog, a session that was violated would be told of as if it were not.
    """

    seq: int
    sessions: dict[int, Row] = field(default_factory=dict)
    pages: list[Page] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    coming: set[int] = field(default_factory=set)
    left: int = 0
    oldest: int | None = None

    @property
    def rows(self) -> int:
        """How many rows it has."""
        return len(self.sessions) + sum(len(page.rows) for page in self.pages) + len(self.changes)


class Robot:
    """A file that a server writes meanwhile. All of it raises `sqlite3.Error`."""

    def __init__(self, path: str) -> None:
        self._database = connect(path)
        self._begun = -1
        self._from: Mapping[int, int] = {}

    def close(self) -> None:
        """Let go of it."""
        self._database.close()

    def begin(self, known: Mapping[int, Known], seq: int) -> bool:
        """Go on behind what the centre has; returns whether it has that of this very history, and no more."""
        with self._reading():
            (self._begun,) = self._one(_LAST)
            self._from = {number: each.position for number, each in known.items()}
            extents = {number: last for number, _, last in self._database.execute(_EXTENTS)}
            return seq <= self._begun and all(
                number not in extents or self._is_same(number, each, extents[number]) for number, each in known.items()
            )

    def gone(self, known: Iterable[int]) -> list[int]:
        """Those of some sessions that retention has deleted here."""
        there = {number for (number,) in self._database.execute("SELECT number FROM sessions")}
        return [number for number in known if number not in there]

    def read(self, cursors: Mapping[int, int], seq: int, most: int) -> Chunk:
        """What comes next: steps, and once all of these are there, what has changed. `cursors` are by session."""
        with self._reading():
            chunk, room = Chunk(seq), _Room(most)
            chunk.coming = {number for (number,) in self._database.execute(_COMING, ("sessions", seq))}
            extents = self._database.execute(_EXTENTS).fetchall()
            for number, first, last in extents:
                after = cursors.get(number, 0)
                if last > after:
                    rows = self._steps(number, after, room)
                    if rows:
                        chunk.pages.append(Page(number, first, rows))
                        self._mention(chunk, number, cursors)
                        self._read_episodes(chunk, number, rows, room)
                    self._count(chunk, number, max(after, first - 1) + len(rows), last)
            (changed,) = self._one("SELECT count(*) FROM changes WHERE seq > ?", (seq,))
            chunk.left += changed
            if not room.is_full:
                self._read_changes(chunk, cursors, {number for number, *_ in extents}, room)
            return chunk

    def _is_same(self, number: int, known: Known, last: int) -> bool:
        if known.position > max(last, *self._one(_NOTED, (number,))):
            return False
        if known.opened is not None and self._one(_OPENED, (number,)) != (known.opened,):
            return False
        judged = self._database.execute(_JUDGED, (number, known.position)).fetchone()
        return judged is None or known.judged is None or judged[0] == known.judged

    def _steps(self, number: int, after: int, room: _Room) -> list[Row]:
        columns = ",".join(BY_NAME["steps"].columns)
        sql = f"SELECT {columns} FROM steps WHERE session = ? AND position > ? ORDER BY position"  # noqa: S608
        found: list[Row] = []
        with closing(self._database.execute(sql, (number, after))) as cursor:
            while not room.is_full and (rows := cursor.fetchmany(min(BATCH, room.rows))):
                found += rows
                room.take(rows)
        return found

    def _read_episodes(self, chunk: Chunk, number: int, steps: list[Row], room: _Room) -> None:
        rows = self._database.execute(_BEGUN_IN, (number, steps[0][1], steps[-1][1])).fetchall()
        chunk.changes += [Change(_EPISODES.name, row[: _EPISODES.keys], row) for row in rows]
        room.take(rows)

    def _count(self, chunk: Chunk, number: int, reached: int, last: int) -> None:
        chunk.left += last - reached
        found = self._database.execute(_JUDGED, (number, reached + 1)).fetchone() if last > reached else None
        if found is not None:
            chunk.oldest = found[0] if chunk.oldest is None else min(chunk.oldest, found[0])

    def _read_changes(self, chunk: Chunk, cursors: Mapping[int, int], there: set[int], room: _Room) -> None:
        there_already = {(change.table, change.key) for change in chunk.changes}
        for seq, name, session, *key in self._database.execute(_CHANGES, (chunk.seq, room.rows)).fetchall():
            if room.is_full:
                return
            chunk.seq, chunk.left = seq, chunk.left - 1
            if session in there and not (name == "steps" and self._is_brought(cursors, session, key[0], seq)):
                change = self._change(name, session, key)
                if change is not None and (change.table, change.key) not in there_already:
                    self._mention(chunk, session, cursors)
                    chunk.changes.append(change)
                    room.take([change.row or ()])

    def _is_brought(self, cursors: Mapping[int, int], session: int, position: int, seq: int) -> bool:
        """Whether a step is brought as it is now, or was when it had changed so already."""
        return position > cursors.get(session, 0) or (seq <= self._begun and position > self._from.get(session, 0))

    def _change(self, name: str, session: int, key: list[Any]) -> Change | None:
        table = BY_NAME["episodes" if name == GONE else name]
        keys = (session, *key)[: table.keys]
        row = self._row(table, keys)
        if name == GONE:
            return Change(table.name, keys, None) if row is None else None
        return None if row is None else Change(table.name, keys, row)

    def _mention(self, chunk: Chunk, session: int, cursors: Mapping[int, int]) -> None:
        if session not in cursors and session not in chunk.sessions:
            row = self._row(BY_NAME["sessions"], (session,))
            assert row is not None  # noqa: S101 -- it is in the same transaction as what mentions it
            chunk.sessions[session] = row

    def _row(self, table: Table, keys: tuple[Any, ...]) -> Row | None:
        where = " AND ".join(f"{name} = ?" for name in table.columns[: table.keys])
        sql = f"SELECT {','.join(table.columns)} FROM {table.name} WHERE {where}"  # noqa: S608
        found: Row | None = self._database.execute(sql, keys).fetchone()
        return found

    def _one(self, sql: str, values: tuple[Any, ...] = ()) -> Row:
        row: Row = self._database.execute(sql, values).fetchone()
        return row

    @contextmanager
    def _reading(self) -> Iterator[None]:
        self._database.execute("BEGIN")
        try:
            yield
        finally:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")


class _Room:
    """What a chunk may still have."""

    def __init__(self, rows: int) -> None:
        self.rows, self._characters = rows, CHARACTERS

    @property
    def is_full(self) -> bool:
        return self.rows <= 0 or self._characters <= 0

    def take(self, rows: list[Row]) -> None:
        self.rows -= len(rows)
        self._characters -= sum(len(value) for row in rows for value in row if isinstance(value, str))
