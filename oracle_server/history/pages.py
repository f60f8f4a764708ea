"""Verdict records of a history, a page at a time."""

from __future__ import annotations

from dataclasses import replace

from oracle_server.history.matching import page_size
from oracle_server.history.port import Reading
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord
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
