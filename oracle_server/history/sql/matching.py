"""Verdict records in the database, as a query asks for them."""

from __future__ import annotations

from oracle_server.history import matching
from oracle_server.history.matching import Take, Told
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord
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
        where, values = conditions(session.number, query, lower, upper)
        found = reader.execute(f"{STEPS} WHERE {where} ORDER BY position {query.order.upper()}", values)
        at = upper if query.ascending else lower
        for count, step in enumerate(map(step_of, found), 1):
            if not take(step) or count == _PAGE:
                at = step.position
                break
        at += 1 if query.ascending else -1
        return at if first <= at <= last else None

    return matching.told(session, query, doubts, look)
