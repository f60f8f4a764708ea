"""Verdict records of a history, a page at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from oracle_server.core.records import VerdictRecord
from oracle_server.history.port import Reading
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.views import Doubts, records

T = TypeVar("T")


async def find(history: Reading, session: SessionRecord, query: Query) -> tuple[list[VerdictRecord], int | None]:
    """The records that a query asks for, and the `n` to go on after, None where there are no more."""
    return await find_as(history, session, query, lambda record: record)


async def find_as(
    history: Reading,
    session: SessionRecord,
    query: Query,
    make: Callable[[VerdictRecord], T],
    doubts: Doubts | None = None,
) -> tuple[list[T], int | None]:
    """The same with what is made of each record, in the thread that reads: many records would be many objects.

    `doubts` are those of an open session that revises.
    """
    found = _Found(session.properties, query, make, doubts)
    position: int | None = query.start(len(session.properties))
    while position is not None and not found.full:
        position = await history.matching(session.number, query, position, found.take)
    made = [made for _, made in found.made[: query.limit]]
    return made, found.made[query.limit - 1][0] if found.full else None


async def latest(history: Reading, session: SessionRecord) -> int:
    """The `n` of a session's last committed record, 0 where there is none."""
    _, last = await history.extent(session.number)
    return last * len(session.properties)


class _Found(Generic[T]):
    """The records of a page, and one more where there are more; each is kept as what is made of it, with its `n`."""

    def __init__(
        self, properties: tuple[str, ...], query: Query, make: Callable[[VerdictRecord], T], doubts: Doubts | None
    ) -> None:
        self.made: list[tuple[int, T]] = []
        self._properties, self._query, self._make, self._doubts = properties, query, make, doubts

    @property
    def full(self) -> bool:
        return len(self.made) > self._query.limit

    def take(self, step: StoredStep) -> bool:
        """Take the wanted records of a step; whether there is room for more."""
        found = records(step, self._properties, self._query.view, self._doubts)
        for record in found[:: 1 if self._query.ascending else -1]:
            if not self.full and self._query.matches(record):
                self.made.append((record["n"], self._make(record)))
        return not self.full
