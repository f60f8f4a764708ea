"""The work of one commit: written together, or piece by piece where the database refuses a value in it."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import msgspec

from oracle_server.core.revisions import Revision
from oracle_server.history.records import restated
from oracle_server.history.sql.database import Database, Insert
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.schema import REFUSED_COLUMNS, STEP_COLUMNS
from oracle_server.history.sql.standing import RESTATE, restate_text
from oracle_server.history.sql.troubles import NOTE, note

COLUMNS = {"steps": STEP_COLUMNS, "refused": REFUSED_COLUMNS}
"""The tables into which rows are inserted many to a statement."""
REFUSED = (
    sqlite3.DataError, sqlite3.IntegrityError, sqlite3.InterfaceError, sqlite3.ProgrammingError,
    ValueError, OverflowError, TypeError, LookupError, AttributeError, RecursionError, msgspec.MsgspecError,
)  # fmt: skip
"""What is raised for a value that can't be kept, now or ever; a disk that is full or fails raises other errors."""
_CHUNK = 64
"""The most rows of one statement: its values are bound while no other thread can run."""
_LONG = 2**17
"""Characters of signals and explanations beyond which it has fewer: SQLite copies them."""
OF_ONE = 64
"""Steps of which something else stands, or episodes, that count as one row."""
_TEXTS = [STEP_COLUMNS.index("signals"), STEP_COLUMNS.index("explanations")]


class Then(NamedTuple):
    """A statement that is executed after a piece of work, together with it or not at all.

    Its values are made in the writer's thread. It counts as `size` rows, and changes the steps at `positions`.
    """

    what: str
    make: Callable[[], Sequence[Any]]
    size: int
    positions: Iterable[int] = ()


@dataclass(slots=True)
class Work:
    """A piece of work for a session: rows of a table, or a statement with its values.

    Where it is refused, nothing later of its session is written, unless the piece is not `needed` for that. What is
    written `always` is written all the same.
    """

    session: int
    what: str | Exception
    """A table of `COLUMNS`, a statement, or why there are no values for it."""
    values: Sequence[Any]
    done: Callable[[], object] | None = None
    needed: bool = True
    always: bool = False
    then: Then | None = None


class Refused(NamedTuple):
    """A piece of work that can't be written, the name of its session, and why."""

    work: Work
    name: str
    reason: str


def insert_rows(database: Database, table: str, rows: list[Row]) -> None:
    """Insert rows into one of `COLUMNS`, many to a statement."""
    start = 0
    while start < len(rows):
        size = min(_CHUNK, 1 << ((len(rows) - start).bit_length() - 1))  # few sizes, so that statements are cached
        while size > 1 and table == "steps" and _length(rows[start : start + size]) > _LONG:
            size //= 2
        _insert_at_once(database, table, rows[start : start + size])
        start += size


def _insert_at_once(database: Database, table: str, rows: list[Row]) -> None:
    """Insert with one statement, which names no column without values: binding NULL takes ten times as long as 0."""
    columns = zip(COLUMNS[table], zip(*rows, strict=True), strict=True)
    filled = [(name, values) for name, values in columns if any(value is not None for value in values)]
    place = f"({','.join('?' * len(filled))})"
    names = ",".join([name for name, _ in filled])
    statement = f"INSERT INTO {table} ({names}) VALUES {','.join([place] * len(rows))}"  # noqa: S608
    database.execute(statement, [*chain.from_iterable(zip(*[values for _, values in filled], strict=True))])


def _length(rows: list[Row]) -> int:
    return sum(len(row[place] or "") for row in rows for place in _TEXTS)


def write(database: Database, work: Sequence[Work], insert: Insert = insert_rows) -> None:
    """Write all work. Raises what the database raises, `REFUSED` for a value that can't be kept."""
    for what, values in _merged(work):
        if isinstance(what, Exception):
            raise what
        if what in COLUMNS:
            insert(database, what, values)
        else:
            database.executemany(what, values)


def write_apart(database: Database, work: Sequence[Work], insert: Insert) -> tuple[list[Work], list[Refused]]:
    """Write all work but what is refused, and what is behind that in its session.

    Returns what is written, and what is refused.
    """
    written: list[Work] = []
    refused: list[Refused] = []
    ended: set[int] = set()
    for one in work:
        if one.session in ended and not one.always:
            continue
        database.execute("SAVEPOINT piece")
        try:
            write(database, [one], insert)
        except REFUSED as error:
            database.execute("ROLLBACK TO piece")
            reason = str(error) or type(error).__name__
            refused.append(Refused(one, _name(database, one.session), reason))
            if one.needed:
                ended.add(one.session)
                database.execute(NOTE, note(one.session, unkept_text(reason)))
        else:
            written.append(one)
        database.execute("RELEASE piece")
    return written, refused


def unkept_text(reason: str) -> str:
    """What people are told of a session of which nothing more can be kept."""
    return f"nothing more of it can be kept: {reason}"


def _name(database: Database, session: int) -> str:
    try:
        found = database.execute("SELECT id FROM sessions WHERE number = ?", (session,)).fetchone()
    except REFUSED:
        found = None
    return found[0] if found else str(session)


def _merged(work: Sequence[Work]) -> list[tuple[str | Exception, list[Any]]]:
    """The work with consecutive rows of one table, or values of one statement, combined."""
    merged: list[tuple[str | Exception, list[Any]]] = []
    for one in work:
        if not merged or merged[-1][0] != one.what:
            merged.append((one.what, []))
        merged[-1][1].extend(one.values if one.what in COLUMNS else [one.values])
        if one.then is not None:
            merged.append((one.then.what, [_values(one.then)]))
    return merged


def _values(then: Then) -> Sequence[Any]:
    """The values of a statement. Raises `ValueError` for any fault: tried again, it would hold all others' work up."""
    try:
        return then.make()
    except Exception as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def restating(session: int, revisions: Sequence[Revision]) -> Then:
    """What keeps what stands since revisions: 10,000 steps take 0.1 s to tell, while which others are served."""
    standing = [stands for revision in revisions for stands in revision.standing.values()]
    size = 1 + len(standing) // OF_ONE + sum(bool(stands.explanations) for stands in standing)
    positions = {position for revision in revisions for position in revision.standing}
    return Then(RESTATE, lambda: (restate_text(session, restated(revisions)),), size, positions)
