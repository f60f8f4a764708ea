"""Verdict records in the database, as a query asks for them."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.history import matching
from oracle_server.history.matching import Take, Told
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.rows import conditions, step_of
from oracle_server.history.sql.statements import EXTENT, STEPS
from oracle_server.history.views import Doubts

_PAGE = 1_000
"""Steps of which records are made in one turn: some 30 ms."""
_SCAN = 20_000
"""Positions that are looked at in one turn for steps that match: some 20 ms."""
_SCAN_INDEX = 1_000_000
"""The same for violations, which have an index."""
_AT_ONCE = 64
"""Rows that a database gives at once."""


def told(reader: Database, session: SessionRecord, query: Query, position: int, doubts: Doubts | None) -> Told:
    """The records that a query asks for, from a position on."""

    def look(take: Take) -> int | None:
        first, last = reader.execute(EXTENT, (session.number,)).fetchone()
        ahead = _SCAN_INDEX if query.violations else _SCAN
        if query.ascending:
            lower = max(position, first)
            upper = min(lower + ahead, last)
        else:
            upper = min(position, last)
            lower = max(upper - ahead, first)
        at = upper if query.ascending else lower
        for count, step in enumerate(_matching(reader, session, query, lower, upper), 1):
            if not take(step) or count == _PAGE:
                at = step.position
                break
        at += 1 if query.ascending else -1
        return at if first <= at <= last else None

    return matching.told(session, query, doubts, look)


def _matching(reader: Database, session: SessionRecord, query: Query, lower: int, upper: int) -> Iterator[StoredStep]:
    """The steps of some positions that may hold a wanted record; a few at once, as each may have a megabyte."""
    is_more = True
    while is_more:
        where, values = conditions(session.number, query, lower, upper)
        sql = f"{STEPS} WHERE {where} ORDER BY position {query.order.upper()} LIMIT {_AT_ONCE}"
        is_more = False
        for count, step in enumerate(map(step_of, reader.execute(sql, values)), 1):
            is_more = count == _AT_ONCE
            yield step
            lower, upper = (step.position + 1, upper) if query.ascending else (lower, step.position - 1)
