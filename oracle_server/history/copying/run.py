"""The command `history copy`: every row of a history, to another database.

A page of rows and how far it has got are one transaction of the target. So a copy that was ended anywhere goes on where
it was, and no row is there twice; until all are there, the target's format is one that no server reads.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing
from os.path import realpath
from typing import Any, NamedTuple

import msgspec

from oracle_server.core.units import counted
from oracle_server.extras import install
from oracle_server.history.copying.ends import CopyError, End
from oracle_server.history.copying.insqlite import SqliteEnd, file_of
from oracle_server.history.copying.tables import Key, Table
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.schema import UNFINISHED, VERSION, FormatError
from oracle_server.process.progress import Show, progress
from oracle_server.process.settings import POSTGRES

_ROWS = 4_000
_CHARACTERS = 4_000_000
"""A page has no more rows than that, and hardly more text."""
_COPIED = "CREATE TABLE IF NOT EXISTS copied (source TEXT NOT NULL, place TEXT NOT NULL, count BIGINT NOT NULL)"
"""Of a target: what was copied, how far, and how many rows that were."""
_DONE = "all of it"
_STEPS = """
SELECT coalesce(sum(
    coalesce((SELECT max(position) FROM steps WHERE session = sessions.number), 0)
    - coalesce((SELECT min(position) FROM steps WHERE session = sessions.number), 1) + 1
), 0) FROM sessions
"""
"""How many steps there are, without counting them."""


class Copied(NamedTuple):
    """What a target has: so many rows, and whether a copy before this one had brought all."""

    rows: int
    already: bool


class _Place(NamedTuple):
    """How far a copy is: the table, and the key of the last row; None where none of it is there."""

    table: str
    after: Key | None = None


def copy_history(source: str, target: str) -> None:
    """Copy a history, and say so. Raises `OracleError`."""
    if _same(source, target):
        what = "the database" if source.startswith(POSTGRES) else source  # its URL may have a password
        raise CopyError(f"{what}: can't be copied to itself; name another place as TO")
    with closing(_end(source, source=True)) as whence, closing(_end(target, source=False)) as whither:
        with progress("rows", "rows") as show:
            copied = copy(whence, whither, show)
        was = "was copied already" if copied.already else "copied"
        sys.stdout.write(f"{whence.where} {was} to {whither.where}: {counted(copied.rows, 'row')}\n")


def copy(source: End, target: End, show: Show) -> Copied:
    """Copy all rows that are not there yet. Raises `HistoryError`."""
    _demand_source(source)
    state = source.state()
    place, count = _begin(source, target, state)
    if place is None:
        return Copied(count, already=True)
    both = _tables(source, target)
    total = _count(source, both)
    left = both[[table.name for table in both].index(place.table) :]
    for table in left:
        place = _moved(target, place, place if table.name == place.table else _Place(table.name), count)
        for page in _pages(source, table, place.after):
            count += len(page)
            with target.transaction():
                place = _move(target, place, _Place(table.name, page[-1][: table.keys]), count)
                target.insert(table, page)
            show(count, total, count)
    if source.state() != state:
        raise CopyError(f"a server has used {source.where} meanwhile; {_anew(target)}")
    with target.transaction():
        target.execute("UPDATE copied SET place = ?", (_DONE,))
        target.have_brought(source.forwarded())
        target.hand_over()
        target.mark(VERSION)
    target.settle()
    return Copied(count, already=False)


def _same(source: str, target: str) -> bool:
    files = not source.startswith(POSTGRES) and not target.startswith(POSTGRES)
    return source == target or (files and realpath(file_of(source)) == realpath(file_of(target)))


def _end(text: str, *, source: bool) -> End:
    if not text.startswith(POSTGRES):
        return SqliteEnd(text, source=source)
    try:
        from oracle_server.history.copying.inpostgres import PostgresEnd
    except ImportError:
        raise CopyError(
            f"a history in PostgreSQL needs the package psycopg; install it: `{install('postgres')}`"
        ) from None
    return PostgresEnd(text)


def _demand_source(source: End) -> None:
    """Raise `HistoryError` where there is no history, or not all of it; one of an older format is brought to this."""
    version = source.version()
    if version == 0:
        raise CopyError(f"{source.where}: there is no history in it")
    if not 0 < version <= VERSION:
        raise FormatError(version)
    if version < VERSION:
        source.prepare()


def _begin(source: End, target: End, state: str) -> tuple[_Place | None, int]:
    """Where to go on, None where all is there, and how many rows are; a new target belongs to this copy from now on."""
    version = target.version()
    if version not in {*range(VERSION + 1), UNFINISHED}:
        raise FormatError(version)
    if version != UNFINISHED:
        target.prepare()
    with target.transaction():
        target.execute(_COPIED)
        found = target.execute("SELECT source, place, count FROM copied").fetchone()
        if target.version() == UNFINISHED:
            if found[0] != state:
                raise CopyError(
                    f"{target.where}: has a part of another history, or of this one before a server used it; "
                    f"{_anew(target)}"
                )
            return msgspec.json.decode(found[1], type=_Place), found[2]
        if found is not None and found[:2] == (state, _DONE):
            return None, found[2]
        if target.execute("SELECT 1 FROM sessions").fetchone():
            raise CopyError(f"{target.where}: has sessions already; copy {source.where} to an empty one")
        place = _Place(_tables(source, target)[0].name)
        target.execute("DELETE FROM copied")
        target.execute("INSERT INTO copied VALUES (?, ?, 0)", (state, _text(place)))
        target.mark(UNFINISHED)
    return place, 0


def _tables(source: End, target: End) -> list[Table]:
    """The tables that both have."""
    names = {table.name for table in target.tables()}
    return [table for table in source.tables() if table.name in names]


def _anew(target: End) -> str:
    return f"delete what is in {target.where}, and copy anew"


def _moved(target: End, was: _Place, now: _Place, count: int) -> _Place:
    with target.transaction():
        return _move(target, was, now, count)


def _move(target: End, was: _Place, now: _Place, count: int) -> _Place:
    """Keep how far the copy is, within a transaction. Raises `CopyError` where another one has moved it."""
    values = (_text(now), count, _text(was))
    moved: Any = target.execute("UPDATE copied SET place = ?, count = ? WHERE place = ?", values)
    if moved.rowcount != 1:
        raise CopyError(f"{target.where}: another copy into it goes on")
    return now


def _text(place: _Place) -> str:
    return msgspec.json.encode(place).decode()


def _pages(source: End, table: Table, after: Key | None) -> Iterator[list[Row]]:
    """The rows of a table, as many at once as one transaction is to have."""
    page: list[Row] = []
    size = 0
    with closing(source.read(*table.reading(after))) as batches:
        for rows in batches:
            page += rows
            size += sum(len(value) for row in rows for value in row if isinstance(value, str))
            if len(page) >= _ROWS or size >= _CHARACTERS:
                yield page
                page, size = [], 0
    if page:
        yield page


def _count(source: End, both: list[Table]) -> int:
    """How many rows there are, of all tables."""
    others = [table.name for table in both if table.name != "steps"]
    statements = [_STEPS, *(f"SELECT count(*) FROM {name}" for name in others)]  # noqa: S608
    return sum(int(source.execute(sql).fetchone()[0]) for sql in statements)
