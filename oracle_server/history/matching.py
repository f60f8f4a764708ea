"""Which records of steps a query asks for, as JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.views import Doubts, records
from oracle_server.wire.json import encode_bytes

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

    def take(step: StoredStep) -> bool:
        made = records(step, session.properties, query.view, doubts)
        for record in made[:: 1 if query.ascending else -1]:
            if len(found) <= query.limit and query.matches(record):
                found.append((record["n"], encode_bytes(record)))
        return len(found) <= query.limit

    position = look(take)
    return Told(found, position)
