"""Verdict records of a history, a page at a time."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import islice

from oracle_server.core.records import VerdictRecord
from oracle_server.history.port import Reading
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord, StoredStep, records


async def find(history: Reading, session: SessionRecord, query: Query) -> tuple[list[VerdictRecord], int | None]:
    """The records that a query asks for, and the `n` to go on after, None where there are no more."""
    found: list[VerdictRecord] = []
    position = query.start(len(session.properties))
    while steps := await history.matching(session.number, query, position):
        # in a thread: a thousand records take their time, and decisions would wait
        found += await history.in_thread(
            partial(_matching, steps, session.properties, query, query.limit + 1 - len(found))
        )
        if len(found) > query.limit:
            del found[query.limit :]
            return found, found[-1]["n"]
        position = steps[-1].position + (1 if query.ascending else -1)
    return found, None


async def latest(history: Reading, session: SessionRecord) -> int:
    """The `n` of a session's last committed record, 0 where there is none."""
    _, last = await history.extent(session.number)
    return last * len(session.properties)


def _matching(steps: Sequence[StoredStep], properties: tuple[str, ...], query: Query, most: int) -> list[VerdictRecord]:
    direction = 1 if query.ascending else -1
    made = (record for step in steps for record in records(step, properties)[::direction])
    return list(islice(filter(query.matches, made), most))
