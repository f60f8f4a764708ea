"""The centre's history, into which a robot's is brought: each chunk in one transaction, with how far that is.

Sessions have numbers of the centre's own, and names with the robot's. What is brought again takes the place of what is
there; what was deleted at the centre stays deleted.
"""

from __future__ import annotations

import math
import secrets
import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import msgspec

from oracle_server.core.errors import HistoryError
from oracle_server.history.copying.tables import Table
from oracle_server.history.forwarding.robot import BY_NAME, Change, Chunk, Known, Page
from oracle_server.history.origins import forwarded_name, missing_text
from oracle_server.history.postgres.connection import Connection
from oracle_server.history.postgres.schema import TAKES_FORWARDED, TELLS_BEHIND, check, prepare
from oracle_server.history.sql.rows import Row, text
from oracle_server.history.sql.schema import VERSION, FormatError
from oracle_server.history.sql.statements import upsert

_PATIENCE = 60.0
"""Seconds for an answer: a robot's network may be slow."""
_MADE = "SELECT to_regclass('format') IS NOT NULL AND to_regclass('forwarded') IS NOT NULL"
_CLAIM = """
INSERT INTO origins (origin, robot, writer, seq) VALUES (?, ?, ?, 0)
ON CONFLICT (origin, robot) DO UPDATE SET writer = excluded.writer RETURNING seq
"""
"""It waits for what a process before this one has begun."""
_OF_WRITER = "WHERE origin = ? AND robot = ? AND writer = ?"
_HOLD = f"UPDATE origins SET seq = ?, heard = clock_timestamp() {_OF_WRITER}"  # noqa: S608
_BEHIND = f"UPDATE origins SET behind = ? {_OF_WRITER}"  # noqa: S608
_WORTH_TELLING = 60.0
"""Seconds by which what was judged may come later than it usually does before the centre says that it is behind."""
_HEARD = "UPDATE origins SET heard = clock_timestamp() WHERE origin = ? AND robot = ? AND writer = ? RETURNING 1"
_HEARD_EVERY = 60.0
"""Seconds between two signs of life where nothing is brought."""
_ASKED_EVERY = 10.0
"""Seconds between two questions whether the centre would take anything, where nothing is brought."""
_HELD = "SELECT 1 FROM origins WHERE origin = ? AND robot = ? AND writer = ?"
_KNOWN = """
SELECT f.number, f.session, f.opened, f.position, last.judged, f.gaps FROM forwarded f
LEFT JOIN steps last ON last.session = f.session AND last.position = f.position
WHERE f.origin = ? AND f.robot = ?
"""
_NAMESAKES = (
    "SELECT 1 FROM origins WHERE origin = ? AND robot <> ? AND heard > clock_timestamp() - interval '3 minutes' LIMIT 1"
)
_ANEW = "UPDATE forwarded SET position = 0 WHERE origin = ? AND robot = ?"
_NUMBER = "SELECT nextval('session_numbers')"
_TAKEN = "SELECT 1 FROM sessions WHERE id = ?"
_NEW = """
INSERT INTO forwarded (session, origin, robot, number, position, gaps, own, opened)
VALUES (?, ?, ?, ?, 0, '[]', ?, ?)
"""
_CONTINUING = """
SELECT s.id FROM forwarded f JOIN sessions s ON s.number = f.session
WHERE f.origin = ? AND f.robot = ? AND f.own = ? AND f.number > ? ORDER BY f.number LIMIT 1
"""
_AWAITED = "UPDATE forwarded SET continued = ? WHERE session = ?"
_CAME = """
UPDATE forwarded SET continued = NULL
WHERE origin = ? AND robot = ? AND continued = ? AND number < ? RETURNING session
"""
_STATE = "SELECT state FROM sessions WHERE number = ? AND state IS NOT NULL FOR UPDATE"
_STANDS = "UPDATE sessions SET state = ? WHERE number = ?"
_REACHED = "UPDATE forwarded SET position = ?, gaps = ? WHERE session = ?"
_THERE = "SELECT number FROM sessions WHERE number = ANY(?::bigint[]) ORDER BY number FOR UPDATE"
"""No server deletes them meanwhile."""
_ENDED = """
UPDATE forwarded SET ended = (extract(epoch FROM clock_timestamp()) * 1000000000)::bigint
WHERE session = ? AND ended IS NULL
"""
_REOPEN = """
UPDATE sessions SET closed = NULL, state = NULL WHERE number IN (
    SELECT session FROM forwarded WHERE session = ANY(?::bigint[]) AND ended IS NULL
) AND closed IS NOT NULL
"""
"""They were closed at the centre, where nobody knew whether more of them would come.

Of those that were closed before there was `ended` that is unknown: their end came, and is none that is to come.
"""
_FIRST_OF = "DELETE FROM steps WHERE session = ? AND position BETWEEN ? AND ?"
_REPLACED = "DELETE FROM steps WHERE session = ? AND position = ANY(?::bigint[]) RETURNING position"
_SESSION = "DELETE FROM sessions WHERE number = ? RETURNING id"
_COUNTED = BY_NAME["forgotten"]
_COUNT = (
    upsert(_COUNTED.name, _COUNTED.columns, _COUNTED.columns[: _COUNTED.keys]) + " WHERE excluded.upto > forgotten.upto"
)
"""What each has deleted may be more than what the other has."""
_BEFORE = "SELECT coalesce(max(position), 0) FROM steps WHERE session = ? AND position < ?"

_AT_ITS_END = ("closed", "state")
_CLOSED = BY_NAME["sessions"].columns.index("closed")

_decode = msgspec.json.decode


class _Place(NamedTuple):
    """How far a session is there: its number, the last step's position, and the first and last ones of each gap."""

    session: int
    position: int
    gaps: list[tuple[int, int]]


class Wrote(NamedTuple):
    """How many steps are missing before those that are new, and how many are of sessions that were deleted here."""

    lost: int = 0
    dropped: int = 0


class Centre:
    """A connection. All of it raises `HistoryError`, or `ValueError` for a row that is refused; it is of no use then.

    `places` are by the robot's numbers of its sessions; `shared` tells whether another history came by this origin
    lately, and `is_behind` whether it says that much is still to come.
    """

    def __init__(self, url: str, origin: str, robot: str) -> None:
        """Bring what a `robot` has, by the name of `origin`; no other process brings it any more."""
        self._origin, self._robot, self._writer = origin, robot, secrets.token_hex(8)
        self._heard = self._asked = -math.inf
        self.is_behind = False
        self._database = Connection(url, f"oracle-server forwarding {origin}", _PATIENCE)
        try:
            check(self._database)  # what is brought may be deleted at the robot
            self._demand_format()
            values = (origin, robot, self._writer)
            self.seq: int = self._database.execute(_CLAIM, values).fetchone()[0]
            rows = self._database.execute(_KNOWN, (origin, robot)).fetchall()
            self._tells_behind: bool = self._database.execute(TELLS_BEHIND).fetchone()[0]
            self.shared = self._database.execute(_NAMESAKES, (origin, robot)).fetchone() is not None
        except BaseException:
            self.close()
            raise
        self.known = {number: Known(opened, at, judged) for number, _, opened, at, judged, _ in rows}
        self.places = {number: _Place(session, at, _gaps(gaps)) for number, session, _, at, _, gaps in rows}

    @property
    def cursors(self) -> dict[int, int]:
        """The position of each session's last step."""
        return {number: place.position for number, place in self.places.items()}

    def begin_anew(self) -> None:
        """Have all steps brought again."""
        self._database.execute(_ANEW, (self._origin, self._robot))

    def end(self, numbers: Iterable[int]) -> None:
        """Note of sessions that the robot has deleted that nothing more of them will come, be it their end."""
        self._database.executemany(_ENDED, [(self.places[number].session,) for number in numbers])

    def demand_held(self) -> None:
        """Raise `HistoryError` where the centre does not answer, or would take nothing; it is asked now and then."""
        now = time.monotonic()
        if now - self._asked < min(_ASKED_EVERY, _HEARD_EVERY):
            return
        self._asked = now
        due = now - self._heard >= _HEARD_EVERY
        if not self._database.execute(_HEARD if due else _HELD, (self._origin, self._robot, self._writer)).fetchone():
            raise self._fenced()
        if due:
            self._heard = time.monotonic()

    def _fenced(self) -> HistoryError:
        return HistoryError(f"another process forwards this history as '{self._origin}'")

    def write(self, chunk: Chunk) -> Wrote:
        """Write what a robot has, and how far it is."""
        self._database.execute("BEGIN")
        held: Any = self._database.execute(_HOLD, (chunk.seq, self._origin, self._robot, self._writer))
        if held.rowcount != 1:
            raise self._fenced()
        places = self.places | {number: self._begin(row) for number, row in chunk.sessions.items()}
        behind = self._left_behind(chunk)
        if self._tells_behind:
            self._database.execute(_BEHIND, (behind, self._origin, self._robot, self._writer))
        names = {page.session for page in chunk.pages} | {change.key[0] for change in chunk.changes}
        there = self._there(places[number].session for number in names)
        coming = there & {places[number].session for number in chunk.coming if number in places}
        self._database.execute(_REOPEN, (_array(coming),))
        lost = dropped = 0
        for page in chunk.pages:
            was = places[page.session]
            places[page.session] = self._append(was, page, there=was.session in there)
            lost += _missing(places[page.session]) - _missing(was)
            dropped += 0 if was.session in there else len(page.rows)
        for (table, number), changes in _grouped(chunk.changes).items():
            if places[number].session in there:
                self._replace(BY_NAME[table], places[number], changes)
        self._database.commit()
        self.places, self.seq, self._heard = places, chunk.seq, time.monotonic()
        self.is_behind = behind is not None
        return Wrote(lost, dropped)

    def close(self) -> None:
        """Let go of it."""
        self._database.close()

    def _left_behind(self, chunk: Chunk) -> str | None:
        """What is still to come behind a chunk, where that is old by the robot's clock."""
        old = chunk.oldest is not None and time.time_ns() - chunk.oldest > _WORTH_TELLING * 10**9
        return text([self._writer, chunk.left, chunk.oldest]) if old else None

    def _demand_format(self) -> None:
        version = self._format()
        if version in (None, VERSION) and not self._database.execute(_MADE).fetchone()[0]:
            prepare(self._database)
            version = self._format()
        if version is None or version < 0:
            raise FormatError(version or 0)
        if version != VERSION:
            older, newer = ("centre", "robot") if version < VERSION else ("robot", "centre")
            raise HistoryError(
                f"the centre's history has format {version}, and this server's has {VERSION}: start the {older}'s "
                f"server by the version that the {newer} has"
            )
        if not self._database.execute(TAKES_FORWARDED).fetchone()[0]:
            raise HistoryError(
                "the centre's history was made by an older version: start the centre's server by the version that the "
                "robot has"
            )

    def _format(self) -> int | None:
        if not self._database.execute("SELECT to_regclass('format') IS NOT NULL").fetchone()[0]:
            return None
        found = self._database.execute("SELECT version FROM format").fetchone()
        return None if found is None else int(found[0])

    def _begin(self, row: Row) -> _Place:
        """Have a session there, by a number and a name that are free.

        It is open there until its end comes, behind all steps.
        """
        table = BY_NAME["sessions"]
        row = tuple([None if name in _AT_ITS_END else each for name, each in zip(table.columns, row, strict=True)])
        session: int = self._database.execute(_NUMBER).fetchone()[0]
        number, own, opened = row[0], row[table.columns.index("id")], row[table.columns.index("opened")]
        names = (own, f"{own}.{number}", f"{own}.{self._robot[:8]}.{number}")
        free = (forwarded_name(name, self._origin) for name in names)
        name = next((each for each in free if not self._database.execute(_TAKEN, (each,)).fetchone()), None)
        if name is None:
            raise HistoryError(f"the centre has another session of the name '{forwarded_name(own, self._origin)}'")
        self._database.insert(table.name, [self._session_row(row, session, name, [])], table.columns)
        self._database.execute(_NEW, (session, self._origin, self._robot, number, own, opened))
        for (before,) in self._database.execute(_CAME, (self._origin, self._robot, own, number)).fetchall():
            for (state,) in self._database.execute(_STATE, (before,)).fetchall():
                self._database.execute(_STANDS, (text(_decode(state) | {"continued_by": name}), before))
        return _Place(session, 0, [])

    def _there(self, sessions: Iterable[int]) -> set[int]:
        """Those that were not deleted."""
        asked = _array(sessions)
        return {number for (number,) in self._database.execute(_THERE, (asked,)).fetchall()}

    def _append(self, place: _Place, page: Page, *, there: bool) -> _Place:
        table = BY_NAME["steps"]
        first, last = page.rows[0][1], page.rows[-1][1]
        gaps = place.gaps
        if there:
            before = place.position
            if first > before + 1:
                (before,) = self._database.execute(_BEFORE, (place.session, first)).fetchone()
            if first > before + 1 and (before + 1, first - 1) not in gaps:
                gaps = [*gaps, (before + 1, first - 1)]
            self._database.execute(_FIRST_OF, (place.session, first, last))
            self._database.insert(table.name, [(place.session, *row[1:]) for row in page.rows], table.columns)
        self._database.execute(_REACHED, (last, text(gaps), place.session))
        return _Place(place.session, last, gaps)

    def _replace(self, table: Table, place: _Place, changes: Sequence[Change]) -> None:
        """Have rows as they are at the robot; steps and the session itself only where they are there still."""
        rows = [change.row for change in changes if change.row is not None]
        if table.name == "sessions":
            found = self._database.execute(_SESSION, (place.session,)).fetchall()
            rows = [self._session_row(row, place.session, name, place.gaps) for row in rows[-1:] for (name,) in found]
            if any(row[_CLOSED] is not None for row in rows):
                self._database.execute(_ENDED, (place.session,))
        elif table.name == "steps":
            positions = _array(row[1] for row in rows)
            found = self._database.execute(_REPLACED, (place.session, positions)).fetchall()
            kept = {position for (position,) in found}
            rows = [(place.session, *row[1:]) for row in rows if row[1] in kept]
        elif table == _COUNTED:
            self._database.executemany(_COUNT, [(place.session, *row[1:]) for row in rows])
            rows = []
        else:
            where = " AND ".join(f"{name} = ?" for name in table.columns[: table.keys])
            keys = [(place.session, *change.key[1:]) for change in changes]
            self._database.executemany(f"DELETE FROM {table.name} WHERE {where}", keys)  # noqa: S608
            rows = [(place.session, *row[1:]) for row in rows]
        self._database.insert(table.name, rows, table.columns)

    def _session_row(self, row: Row, session: int, name: str, gaps: Sequence[tuple[int, int]]) -> Row:
        """A session's row at the centre: its end tells its name there, and what is missing of it."""
        columns = BY_NAME["sessions"].columns
        values = dict(zip(columns, row, strict=True)) | {"number": session, "id": name}
        if values["state"] is not None:
            state = _decode(values["state"]) | {"id": name, "origin": self._origin}
            if state.get("continued_by"):
                state["continued_by"] = self._continuing(session, row[0], state["continued_by"])
            if gaps and values["closed"] is not None:  # while it is open they are told by `forwarded`
                state["trouble"] = "; ".join(filter(None, (state.get("trouble"), missing_text(gaps))))
            values["state"] = text(state)
        return tuple([values[column] for column in columns])

    def _continuing(self, session: int, number: int, own: str) -> str | None:
        """The name here of the session that goes on with one, by its own; None until it is here."""
        found = self._database.execute(_CONTINUING, (self._origin, self._robot, own, number)).fetchone()
        self._database.execute(_AWAITED, (None if found else own, session))
        return found[0] if found else None


def _missing(place: _Place) -> int:
    return sum(last - first + 1 for first, last in place.gaps)


def _gaps(told: str) -> list[tuple[int, int]]:
    return _decode(told, type=list[tuple[int, int]])


def _grouped(changes: Iterable[Change]) -> dict[tuple[str, int], list[Change]]:
    """Changes by table and session, each in their sequence."""
    found = defaultdict(list)
    for change in changes:
        found[change.table, change.key[0]].append(change)
    return found


def _array(numbers: Iterable[int]) -> str:
    return "{" + ",".join(str(number) for number in numbers) + "}"
