"""Verdict records of a history, and steps that none may be missing of, a page at a time."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from contextlib import aclosing
from dataclasses import replace

from oracle_server.core.errors import HistoryError
from oracle_server.history.matching import page_size
from oracle_server.history.port import DELETED, Reading
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.views import Doubts


async def find(
    history: Reading, session: SessionRecord, query: Query, doubts: Doubts | None = None
) -> tuple[list[tuple[int, bytes]], int | None]:
    """The records that a query asks for, as JSON, each with its `n`; and the `n` to go on after, None where none are.

    There are fewer than its limit where they are long, and at least one.
    `doubts` are those of an open session that revises.
    """
    found: list[tuple[int, bytes]] = []
    position: int | None = query.start(len(session.properties))
    while position is not None and len(found) <= page_size(found, query.limit):
        wanted = replace(query, limit=query.limit - len(found))
        more, position = await history.told(session, wanted, position, doubts)
        found += more
    page = found[: page_size(found, query.limit)]
    return page, page[-1][0] if len(found) > len(page) else None


async def unbroken(history: Reading, session: int) -> AsyncGenerator[list[StoredStep], None]:
    """The steps of a session by pages, in their sequence.

    Raises `HistoryError` where some are deleted before they are read: without them, what is read would look whole.
    """
    at, (_, last) = 0, await history.extent(session)
    async with aclosing(history.steps(session, 0)) as pages:
        async for page in pages:
            if at and page[0].position > at + 1 and (await history.extent(session))[0] > at + 1:
                break  # else it is what a robot had deleted before it forwarded
            yield page
            at = page[-1].position
        else:
            if at >= last:
                return
    raise HistoryError(DELETED)
