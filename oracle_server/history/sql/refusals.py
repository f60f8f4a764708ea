"""The events of a session that were refused: read, and those found that nobody needs any more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import msgspec

from oracle_server.core.ordering.numbering import Numbering
from oracle_server.history.records import Refusal, SnapshotRecord
from oracle_server.history.sql.damage import readable
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.schema import REFUSED_COLUMNS

_CHUNK = 2_000
"""Rows that are deleted with one commit, so that other commits are not delayed."""
_OF = f"SELECT {','.join(REFUSED_COLUMNS)} FROM refused WHERE session = ?"  # noqa: S608
_BEHIND = f"{_OF} AND monitor = ? AND seq > ?"
_NEWEST = "SELECT at FROM refused WHERE session = ? ORDER BY at DESC LIMIT 1 OFFSET ?"
_OLDER = "SELECT count(*) FROM refused WHERE session = ? AND at <= ?"
_KNOWN = "session = ? AND monitor = ? AND seq <= ? AND at <= ?"
_COUNT = f"SELECT count(*) FROM refused WHERE {_KNOWN}"  # noqa: S608
_DELETE = (
    "DELETE FROM refused WHERE (session, monitor, seq) IN "  # noqa: S608 -- no value is written into it
    f"(SELECT session, monitor, seq FROM refused WHERE {_KNOWN} ORDER BY seq LIMIT {_CHUNK})"
)


class Needless(NamedTuple):
    """Statements that delete refused events, with their values, and how many more are old enough, but `needed`."""

    statements: list[tuple[str, Row]]
    needed: int


def refusals(reader: Database, session: int, after: Mapping[str, int] | None) -> list[Refusal]:
    """The refused events of a session, or of some monitors behind a number of each."""
    if after is None:
        return [_refusal_of(row) for row in reader.execute(_OF, (session,))]
    values = [(session, monitor, seq) for monitor, seq in after.items()]
    return [_refusal_of(row) for each in values for row in reader.execute(_BEHIND, each)]


def needless(reader: Database, session: int, saved: SnapshotRecord | None, keep: int) -> Needless:
    """What is refused of a session before the last `keep`; a start needs those whose numbers are not `saved`."""
    newest = reader.execute(_NEWEST, (session, keep)).fetchone()
    if newest is None:
        return Needless([], 0)
    (older,) = reader.execute(_OLDER, (session, *newest)).fetchone()
    statements: list[tuple[str, Row]] = []
    for monitor, numbers in ((saved and saved.numbers) or {}).items():
        values = (session, monitor, Numbering((), numbers).upto, *newest)
        (count,) = reader.execute(_COUNT, values).fetchone()
        statements += [(_DELETE, values)] * -(-count // _CHUNK)
        older -= count
    return Needless(statements, older)


@readable(lambda row: f"the refused event {row[2]} of monitor {row[1]} of session number {row[0]}")
def _refusal_of(row: Row) -> Refusal:
    return msgspec.convert(row[1:], Refusal)
