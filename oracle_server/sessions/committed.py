"""How a session stands by what is committed of it, where nobody can tell any more who has judged it."""

from __future__ import annotations

from oracle_server.core.events import Order
from oracle_server.core.verdicts import Outcome
from oracle_server.history.episodes import Cursor, EpisodeQuery
from oracle_server.history.port import History
from oracle_server.history.records import Document, PropertyStands, SessionRecord
from oracle_server.sessions.last import last_rows, stands_at

_PAGE = 1_000
"""Episodes that are read at once."""
_PASSED = "messages went past a monitor before its last verdict"
_Violations = dict[tuple[str, Order], tuple[int, int]]


async def committed(history: History, record: SessionRecord, told: Document) -> Document:
    """What the rows tell of a session's state: `properties`, and the `steps` of `counters`; the rest as it was `told`.

    Raises `HistoryError`.
    """
    rows, violations = await last_rows(history, record), await _violations(history, record.number)
    before = {(row["id"], row["order"]): row for row in told["properties"]}
    properties = []
    for order in [record.decides, *(order for order in rows if order != record.decides)]:
        for i, name in enumerate(record.properties):
            known = before.get((name, order), {"unknown": None})
            last = rows[order].of(i) if order in rows else None
            count, violated = violations.get((name, order), (0, None))
            stands = PropertyStands(name, Outcome.UNKNOWN, count, violated, None)
            stands = stands if last is None else stands_at(last, i, stands)
            if stands.first_violation != known.get("first_violation"):
                known = known | await first_place(history, record, stands.first_violation)
            properties.append(property_state(stands, order) | known | _told(stands))
    steps = max((last.steps for last in rows.values()), default=0)
    return {"properties": properties, "counters": told["counters"] | {"steps": steps}}


def property_state(stands: PropertyStands, order: Order) -> Document:
    """What a state has of a property in an order; what only its judge knows is None, 0 or empty."""
    return {
        "id": stands.property,
        "order": order,
        "first_violation_step": None,
        "first_violation_at": None,
        "unknown": 0,
        "broken": None,
        "complaint": None,
        "unasked": None,
        "caveats": [_PASSED] if stands.bypassed else [],
        "robustness": None,
    } | _told(stands)


def _told(stands: PropertyStands) -> Document:
    return {
        "outcome": stands.outcome.value,
        "first_violation": stands.first_violation,
        "violations": stands.violations,
        "pending": stands.pending,
        "degraded": stands.degraded,
    }


async def _violations(history: History, number: int) -> _Violations:
    """How many violations each property has in each order, and the first one's number, by its episodes."""
    found: _Violations = {}
    after: Cursor | None = None
    while True:
        page, after = await history.episodes(EpisodeQuery(session=number, after=after, limit=_PAGE))
        for each in page:
            key = each["property"], each["order"]
            count, first = found.get(key, (0, each["first"]))
            found[key] = count + each["count"], min(first, each["first"])
        if after is None:
            return found


async def first_place(history: History, record: SessionRecord, first: int | None) -> Document:
    """Where the first violation was, by the number of its verdict, as a property's state has it."""
    row = None if first is None else await history.step(record.number, (first - 1) // len(record.properties) + 1)
    number, stamp = (None, None) if row is None else (row.number, row.step.stamp)
    return {"first_violation_step": number, "first_violation_at": stamp}
