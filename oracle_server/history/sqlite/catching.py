"""Makes, in the background, the blocks of what older versions have written."""

from __future__ import annotations

import asyncio
import sqlite3

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.blocks import SIZE
from oracle_server.history.sqlite.batch import Work
from oracle_server.history.sqlite.blocks import EXTENT
from oracle_server.history.sqlite.reader import Reader
from oracle_server.history.sqlite.writer import Writer

_PAUSE = 0.05
"""Seconds between two turns: the writer has others to serve."""

log = structlog.get_logger()


async def catch_up(reader: Reader, writer: Writer) -> None:
    """Have the writer make all blocks that are missing, those of the newest sessions first."""
    try:
        for session, rows in await reader.run(_behind):
            log.info("the timeline of a session is being made", session=session, steps=rows)
            await _catch_up_one(reader, writer, session, rows)
    except HistoryError as error:
        log.error("timelines can't be made now; they are with the next start", reason=str(error))


async def _catch_up_one(reader: Reader, writer: Writer, session: int, rows: int) -> None:
    """Have the blocks of a session made, for as long as there are more; steps may come meanwhile."""
    last = -1
    while rows >= SIZE:
        done = asyncio.Event()
        writer.add(Work(session, "steps", [], done.set, always=True))
        await done.wait()
        await asyncio.sleep(_PAUSE)
        before, (rows, last) = last, await reader.run(lambda connection: _missing(connection, session))
        if last == before:
            return


def _behind(reader: sqlite3.Connection) -> list[tuple[int, int]]:
    """The sessions that have blocks to be made, and of how many rows."""
    numbers = [number for (number,) in reader.execute("SELECT number FROM sessions ORDER BY number DESC")]
    found = [(number, _missing(reader, number)[0]) for number in numbers]
    return [(number, rows) for number, rows in found if rows >= SIZE]


def _missing(reader: sqlite3.Connection, session: int) -> tuple[int, int]:
    """How many rows of a session have no block, and the number of its last block, -1 for none."""
    found: tuple[int, int, int | None, int | None] = reader.execute(EXTENT, (session,)).fetchone()
    first, last, _, block = found
    following = max(-(-(first - 1) // SIZE), 0 if block is None else block + 1)
    return max(0, last - following * SIZE), -1 if block is None else block
