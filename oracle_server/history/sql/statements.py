"""Statements that read the history or add to it, and the tables that a session has rows in."""

from __future__ import annotations

from collections.abc import Sequence

from oracle_server.history.sql.schema import SESSION_COLUMNS, STEP_COLUMNS

STEPS = f"SELECT {','.join(STEP_COLUMNS)} FROM steps"  # noqa: S608 -- no value is written into a statement
SESSIONS = f"SELECT {','.join(SESSION_COLUMNS)} FROM sessions"  # noqa: S608
OPEN = f"{SESSIONS} WHERE closed IS NULL AND id NOT LIKE '%@%' ORDER BY number"
"""What robots forward is theirs, wherever it is copied to."""
UPTO = "session = ? AND position <= ? AND ord = ?"
EXTENT = (  # each end by itself: one query for both would read all that is between
    "SELECT coalesce((SELECT min(position) FROM steps WHERE session = ?1), 1), "
    "coalesce((SELECT max(position) FROM steps WHERE session = ?1), 0)"
)
_OF_EVENT = "(session, position) IN (SELECT session, position FROM steps WHERE session = ? AND monitor = ? AND seq = ?)"
"""SQLite would read all steps of the session rather than go to each row by an index: the index alone answers this."""
AMEND = f"UPDATE steps SET passed = ?, why = ? WHERE {_OF_EVENT} AND (decision IS NOT NULL OR ask = 0)"  # noqa: S608
"""Where an event is judged by two orders its step in the other one decided nothing."""
ASKED = f"{STEPS} WHERE {_OF_EVENT} AND decision IS NOT NULL"
COUNTED = (
    "coalesce((SELECT number FROM steps WHERE session = s.number AND ord = s.decides AND stream <> '' AND number > 0 "
    "ORDER BY position DESC LIMIT 1), 0)"
)
"""How many steps a session has, in the order that decides: positions count deadlines and revisions, too."""
LAST_TIME = (
    "SELECT coalesce(max(CAST((SELECT judged FROM steps WHERE session = s.number ORDER BY position DESC LIMIT 1) "
    "AS BIGINT)), 0) "
    "FROM sessions s WHERE kind = 'robot' AND id NOT LIKE '%@%'"
)
"""A session's last step was judged last; all of them would be looked at otherwise. Recordings, and robots that
forward, have a time of theirs. Of a damaged row SQLite may give a text."""
BESIDE = (
    "(200 + length(s.text) + coalesce(length(s.state), 0) + coalesce(length(saved.data), 0) "
    "+ (SELECT coalesce(sum(length(monitor) + length(code) + length(message) + 30), 0) FROM refused "
    "WHERE session = s.number))"
)
"""Bytes that a session takes beside its steps, about."""
KEPT = (
    f"SELECT s.number, s.spec, s.closed, coalesce(saved.settled, 0), {BESIDE}, "  # noqa: S608
    "(SELECT count(*) FROM refused WHERE session = s.number), s.closed IS NULL AND s.id LIKE '%@%' "
    "FROM sessions s LEFT JOIN snapshots saved ON saved.session = s.number ORDER BY s.number"
)
OF_A_SESSION = (
    ("steps", "session"), ("blocks", "session"), ("episodes", "session"), ("forgotten", "session"),
    ("refused", "session"), ("monitors", "session"), ("snapshots", "session"), ("sessions", "number"),
)  # fmt: skip
"""The tables that have rows of a session, and their columns with its number; itself at last."""
FORGET_SESSION = [f"DELETE FROM {table} WHERE {key} = ?" for table, key in OF_A_SESSION]  # noqa: S608
SIZE = (
    "SELECT (p.page_count - f.freelist_count) * s.page_size FROM pragma_page_count p, pragma_freelist_count f, "
    "pragma_page_size s"
)


def insertion(table: str, columns: Sequence[str]) -> str:
    """Inserts a row."""
    return f"INSERT INTO {table} ({','.join(columns)}) VALUES ({','.join('?' * len(columns))})"  # noqa: S608


def upsert(table: str, columns: Sequence[str], key: Sequence[str]) -> str:
    """Inserts a row, in place of the one with its key where there is one."""
    others = ",".join(f"{name} = excluded.{name}" for name in columns if name not in key)
    return f"{insertion(table, columns)} ON CONFLICT ({','.join(key)}) DO UPDATE SET {others}"
