"""Verdict records of a history, a page at a time."""

from __future__ import annotations

from collections.abc import AsyncIterator

from oracle_server.history.port import Reading
from oracle_server.history.query import Query
from oracle_server.history.records import Document, SessionRecord, records


async def find(history: Reading, session: SessionRecord, query: Query) -> tuple[list[Document], int | None]:
    """The records that a query asks for, and the `n` to go on after, None where there are no more."""
    found: list[Document] = []
    async for record in _matching(history, session, query):
        if len(found) == query.limit:
            return found, found[-1]["n"]
        found.append(record)
    return found, None


async def latest(history: Reading, session: SessionRecord) -> int:
    """The `n` of a session's last committed record, 0 where there is none."""
    _, last = await history.extent(session.number)
    return last * len(session.properties)


async def _matching(history: Reading, session: SessionRecord, query: Query) -> AsyncIterator[Document]:
    position = query.start(len(session.properties))
    while steps := await history.matching(session.number, query, position):
        for step in steps:
            made = records(step, session.properties)
            for record in made if query.ascending else reversed(made):
                if query.matches(record):
                    yield record
        position = steps[-1].position + (1 if query.ascending else -1)
