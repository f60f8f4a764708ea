"""The episodes of a history of an older format, made of its rows once, where these are not too many."""

from __future__ import annotations

import sqlite3

import msgspec

from oracle_server.core.episode import Following
from oracle_server.core.judging.following import Said, follow_said
from oracle_server.core.kinds import TICK
from oracle_server.core.records import ExplanationRecord
from oracle_server.core.spec import GAP
from oracle_server.core.verdicts import Outcome
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.sql.episodes import END, keeping
from oracle_server.history.sql.standing import outcomes_of, whys_of

_MOST = 2_000_000
"""Rows that are looked at, those of the newest sessions: some 4 s."""
_NOTHING = Following()
_ROWS = """
SELECT position, ord, kind, number, decision, stamp, iif(ord = 'arrival' OR skewed, arrived, stamp),
    coalesce(standing, outcomes), iif(standing IS NULL, explanations, standing_explanations)
FROM steps WHERE session = ? AND revision IS NULL ORDER BY position
"""


def remake(database: sqlite3.Connection) -> None:
    """Keep the episodes of the newest sessions, within the transaction that is open; the others have none.

    Their rows are taken in the sequence in which they were judged, by their stamps.
    """
    left = _MOST
    sessions = database.execute("SELECT number, properties, closed FROM sessions ORDER BY number DESC").fetchall()
    for number, properties, closed in sessions:
        (count,) = database.execute("SELECT count(*) FROM steps WHERE session = ?", (number,)).fetchone()
        left -= count
        if left < 0:
            return
        for sql, values in keeping(number, _of(database, number, msgspec.json.decode(properties))):
            database.execute(sql, values)
        if closed is not None:
            database.execute(END, (number,))


def _of(database: sqlite3.Connection, session: int, properties: list[str]) -> list[StoredEpisode]:
    known: dict[str, Following] = {}
    found: dict[tuple[str, int], StoredEpisode] = {}
    for position, order, kind, number, decision, stamp, time, outcomes, explanations in database.execute(
        _ROWS, (session,)
    ):
        before = known.get(order, _NOTHING)
        if not before.episodes and not ("f" in outcomes or "F" in outcomes):
            continue  # its time matters only to what is open, or begins
        whys = whys_of(explanations)
        said = [_said(outcome or Outcome.UNKNOWN, whys.get(i)) for i, outcome in enumerate(outcomes_of(outcomes))]
        instant = kind != TICK and number == 0 and decision == "deny"
        first = (position - 1) * len(properties) + 1
        entries = before.episodes or (None,) * len(properties)
        known[order], changes = follow_said(
            Following(before.time, entries),
            GAP,
            stamp if kind == TICK else time,
            first,
            enumerate(said),
            instant=instant,
        )
        for change in changes:
            name, key = properties[change.index], (properties[change.index], change.episode.first)
            text = whys[change.index]["text"] if change.kind == "begins" and change.index in whys else None
            if change.is_kept:
                text = found[key].text if key in found else text
                found[key] = StoredEpisode(name, order, change.episode, text)
    return [*found.values()]


def _said(outcome: Outcome, why: ExplanationRecord | None) -> Said:
    if why is None:
        return Said(outcome)
    violations = max(1, why.get("about_count", 1))
    return Said(outcome, violations, None, why)
