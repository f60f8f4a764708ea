"""Makes, in the background, the blocks of what older versions have written."""

from __future__ import annotations

import asyncio

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.blocks import SIZE
from oracle_server.history.sql.blocks import catching
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.reader import Reader
from oracle_server.history.sql.timeline import EXTENT
from oracle_server.history.sql.writer import Writer

_PAUSE = 0.05
"""Seconds between two turns: the writer has others to serve."""
_RETRY = 30.0
"""Seconds until it is tried again where the database can't be read."""

log = structlog.get_logger()


async def catch_up(reader: Reader, writer: Writer) -> None:
    """Have the writer make all blocks that are missing, those of the newest sessions first, and try again."""
    failing = False
    while True:
        try:
            for session in await reader.run(_behind):
                log.info("the timeline of a session is being made", session=session)
                await _catch_up_one(reader, writer, session)
        except HistoryError as error:
            if not failing:
                log.warning("timelines of older sessions can't be made now; it is tried again", reason=str(error))
            failing = True
            await asyncio.sleep(_RETRY)
        else:
            return


async def _catch_up_one(reader: Reader, writer: Writer, session: int) -> None:
    """Have the blocks of a session made, for as long as there come more."""
    made = -1
    while True:
        rows, following = await reader.run(lambda connection: _missing(connection, session))
        if rows < SIZE or following == made:
            return
        made, done = following, asyncio.Event()
        writer.add(catching(session, done.set))
        await done.wait()
        await asyncio.sleep(_PAUSE)


def _behind(reader: Database) -> list[int]:
    """The sessions that have blocks to be made."""
    numbers = [number for (number,) in reader.execute("SELECT number FROM sessions ORDER BY number DESC")]
    return [number for number in numbers if _missing(reader, number)[0] >= SIZE]


def _missing(reader: Database, session: int) -> tuple[int, int]:
    """How many rows of a session are behind its last block of level 0, and the number of the next one."""
    found: tuple[int, int, int | None, int | None] = reader.execute(EXTENT, (session,)).fetchone()
    first, last, _, block = found
    following = max(-(-(first - 1) // SIZE), 0 if block is None else block + 1)
    return last - following * SIZE, following
