"""Open sessions of a file that are not this server's: another process writes it, or robots forwarded them to a centre.

A history that is copied from a centre has robots' sessions as they were then; nobody forwards to a file.
"""

from __future__ import annotations

import msgspec

from oracle_server.history.origins import copied_text, forwarded_name, origin_of
from oracle_server.history.records import Elsewhere, OtherSession
from oracle_server.history.sql.episodes import VIOLATIONS
from oracle_server.history.sql.rows import Row, session_of
from oracle_server.history.sql.schema import SESSION_COLUMNS
from oracle_server.history.sql.standing import stands
from oracle_server.history.sql.statements import COUNTED
from oracle_server.history.sql.troubles import noted

OPEN = (
    f"SELECT {','.join(f's.{name}' for name in SESSION_COLUMNS)}, "  # noqa: S608 -- no value is in it
    f"""
    {COUNTED}, coalesce(last.standing, last.outcomes),
    coalesce(last.standing_degraded, last.degraded), last.pending,
    (SELECT json_group_object(property, json_array(violations, first)) FROM ({VIOLATIONS})),
    (SELECT json_group_array(json_array(name, attached, clock)) FROM monitors WHERE session = s.number), s.state
FROM sessions s LEFT JOIN steps last ON last.session = s.number AND last.position = (
    SELECT position FROM steps
    WHERE session = s.number AND ord = s.decides AND revision IS NULL AND (stream = '' OR number > 0)
    ORDER BY position DESC LIMIT 1
)
WHERE s.closed IS NULL AND (?1 IS NULL OR s.id = ?1) AND (?2 IS NULL OR substr(s.id, -length(?2)) = ?2)
    AND (s.id LIKE '%@%' OR NOT ?3) ORDER BY s.number DESC
"""
)
"""All that are open, the one of a name, those of a robot by how their names end, or those of robots alone."""
IS_OPEN = "SELECT 1 FROM sessions WHERE id = ? AND closed IS NULL"

_decode = msgspec.json.decode


def values(name: str | None, origin: str | None, *, forwarded: bool) -> tuple[str | None, str | None, bool]:
    """Values for `OPEN`: the session of a name, or those of a robot, or all; those that are `forwarded` alone."""
    return name, None if origin is None else forwarded_name("", origin), forwarded


def other(place: Elsewhere | None, row: Row) -> OtherSession:
    """A row of `OPEN` as a session at a place, or at the robot that forwarded it."""
    record = session_of(row[: len(SESSION_COLUMNS)])
    steps, outcomes, degraded, pending, told, them, state = row[-7:]
    properties = stands(record.properties, outcomes, degraded, pending, told) if outcomes else []
    monitors = [(name, attached > 0, clock) for name, attached, clock in _decode(them)]
    origin = origin_of(record.id)
    if place is None or origin is not None:
        place = Elsewhere(origin or "", None, here=False, lasting=False)
    trouble = None if origin is None else copied_text(origin)
    return OtherSession(record, place, steps, properties, monitors, trouble, origin is not None, noted(state))
