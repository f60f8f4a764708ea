"""A robot's history, and what a centre has of it."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path

import msgspec

from oracle_server.history.copying.inpostgres import PostgresEnd
from oracle_server.history.copying.insqlite import SqliteEnd
from oracle_server.history.copying.tables import tables
from oracle_server.history.forwarding.messages import Ask, Told
from oracle_server.history.forwarding.working import Bringing
from oracle_server.history.sql.rows import Row
from oracle_server.history.sqlite.history import NAME, SqliteHistory

ORIGIN = "robot7"


def names(url: str) -> dict[int, tuple[str, int]]:
    """The centre's numbers of sessions, as the robot's history and its number there."""
    with closing(PostgresEnd(url)) as end:
        return {n: (robot, number) for n, robot, number in end.execute("SELECT session, robot, number FROM forwarded")}


def at_the_robot(folder: Path) -> dict[str, list[Row]]:
    with closing(SqliteEnd(str(folder / NAME), source=True)) as end:
        return {t.name: sorted((row for rows in end.read(*t.reading(None)) for row in rows), key=repr)
                for t in tables() if t.name != "snapshots"}  # fmt: skip


def at_the_centre(url: str, robot: str | None = None) -> dict[str, list[Row]]:
    """The rows of a robot's sessions, with its own numbers and names."""
    known = {n: number for n, (which, number) in names(url).items() if robot in (None, which)}
    found: dict[str, list[Row]] = {}
    with closing(PostgresEnd(url)) as end:
        for table in (t for t in tables() if t.name != "snapshots"):
            rows = [row for rows in end.read(*table.reading(None)) for row in rows if row[0] in known]
            found[table.name] = sorted((plain(table.name, table.columns, known, row) for row in rows), key=repr)
    return found


def plain(table: str, columns: tuple[str, ...], known: dict[int, int], row: Row) -> Row:
    values = dict(zip(columns, (known[row[0]], *row[1:]), strict=True))
    if table == "sessions":
        values["id"] = values["id"].rpartition("@")[0]
        if values["state"]:
            state = msgspec.json.decode(values["state"])
            assert state.pop("origin") == ORIGIN
            values["state"] = msgspec.json.encode(state | {"id": values["id"]}).decode()
    return tuple([int(v) if isinstance(v, bool) else v for v in values.values()])


@asynccontextmanager
async def robot(folder: Path) -> AsyncIterator[SqliteHistory]:
    history = SqliteHistory(folder, forwarding=True)
    history.start(asyncio.get_running_loop())
    yield history
    await asyncio.to_thread(history.close)


async def brought(
    history: SqliteHistory, url: str, bringing: Bringing, rows: int = 8_000, *, once: bool = False
) -> Told:
    """Bring all that there is, or a chunk; the last answer."""
    noted = history.forwarding
    assert noted is not None
    while True:
        known = await noted.stands()
        told = await asyncio.to_thread(
            bringing.bring, Ask(os.fsencode(noted.path), url, ORIGIN, known.robot, known.seq, rows)
        )
        assert told.error is None, told.error
        if told.anew is not None:
            await noted.begin_anew(known=told.anew == "less")
            continue
        await noted.note(told.seq, told.reached)
        if once or not told.left:
            return told
