"""Which records of steps a query asks for, as JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import NamedTuple

from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.views import Doubts, records
from oracle_server.wire.json import encode_bytes

MOST_BYTES = 2**21
"""A page has no more records behind the one by which it has so many bytes: it is copied while decisions wait."""
Take = Callable[[StoredStep], bool]
"""Takes a step that may hold a wanted record; whether there is room for more."""


class Told(NamedTuple):
    """Records as JSON, each with its `n`, and the position to go on from: None where there are no more."""

    records: list[tuple[int, bytes]]
    position: int | None


def told(session: SessionRecord, query: Query, doubts: Doubts | None, look: Callable[[Take], int | None]) -> Told:
    """The records of a page, and one more where there are more.

    `look` gives steps that may hold them, until there is no room, and returns the position behind the last one.
    """
    found: list[tuple[int, bytes]] = []
    size = 0  # of all but the last one

    def has_room() -> bool:
        return len(found) <= query.limit and size < MOST_BYTES

    def take(step: StoredStep) -> bool:
        nonlocal size
        made = records(step, session.properties, query.view, doubts)
        for record in made[:: 1 if query.ascending else -1]:
            if has_room() and query.matches(record):
                size += len(found[-1][1]) if found else 0
                found.append((record["n"], encode_bytes(record)))
        return has_room()

    position = look(take)
    return Told(found, position)


def page_size(found: Sequence[tuple[int, bytes]], limit: int) -> int:
    """How many of some records are a page: as many as are wanted, or fewer where these are long."""
    totals = accumulate(len(text) for _, text in found)
    return min(limit, next((count for count, total in enumerate(totals, 1) if total >= MOST_BYTES), limit))
