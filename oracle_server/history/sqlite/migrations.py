"""How a history of an older format becomes one of this: in place, in one transaction."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from oracle_server.core.errors import HistoryError
from oracle_server.history.sql.schema import DDL, VERSION, FormatError
from oracle_server.history.sqlite.remaking import remake

_STEPS = {
    1: "ALTER TABLE monitors ADD COLUMN clock TEXT NOT NULL DEFAULT 'wall';",
    2: "ALTER TABLE sessions ADD COLUMN asked TEXT;",
    3: "CREATE TABLE IF NOT EXISTS snapshots"
    "(session INTEGER PRIMARY KEY, position INTEGER NOT NULL, data TEXT NOT NULL);"
    "ALTER TABLE snapshots ADD COLUMN settled INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE snapshots ADD COLUMN numbers TEXT;",
    4: "ALTER TABLE steps ADD COLUMN robustness TEXT;",
    5: "ALTER TABLE sessions ADD COLUMN begun INTEGER;"
    "ALTER TABLE monitors ADD COLUMN bypasses TEXT NOT NULL DEFAULT '[]';",
    6: "".join(
        f"ALTER TABLE steps ADD COLUMN {column};"
        for column in (
            "released TEXT",
            "unheard TEXT",
            "place INTEGER",
            "standing TEXT",
            "standing_degraded TEXT",
            "standing_explanations TEXT",
            "revised TEXT",
            "revision TEXT",
        )
    ),
    7: "ALTER TABLE steps ADD COLUMN pending TEXT;",
    # what decides was told by the spec alone; one with both orders is decided by publication
    8: "ALTER TABLE sessions ADD COLUMN decides TEXT NOT NULL DEFAULT 'publication';"
    "UPDATE sessions SET decides = 'arrival' WHERE asked = 'arrival' OR (asked IS NULL AND text LIKE '%arrival%' "
    "AND NOT EXISTS (SELECT 1 FROM steps WHERE session = sessions.number AND ord = 'publication'));"
    "ALTER TABLE sessions ADD COLUMN kind TEXT NOT NULL DEFAULT 'robot';"
    "ALTER TABLE monitors ADD COLUMN left_at INTEGER;",
    9: "",  # the table of episodes is new, and is filled by `remake`
    10: "ALTER TABLE steps ADD COLUMN row INTEGER; DROP INDEX IF EXISTS steps_by_seq;",
    11: "",  # the table of what is forgotten is new
}
"""By the version that they start from: statements that lead to the next one."""
_EPISODES = 10
"""The first format with episodes."""
_OWN = frozenset(("sessions", "steps", "monitors"))
"""Tables that a history of any format has."""


def demand_own(database: sqlite3.Connection, path: Path) -> None:
    """Raise `HistoryError` for a database of another program: tables would be added to it, and its version changed."""
    (version,) = database.execute("PRAGMA user_version").fetchone()
    names = {name for (name,) in database.execute("SELECT name FROM sqlite_master")}
    if (names and not version) or (0 < version <= VERSION and not names >= _OWN):
        raise HistoryError(
            f"{path}: is a database of another program: let the server have a directory of its own (`--data-dir`)"
        )


def migrate(database: sqlite3.Connection) -> int:
    """Bring a database to this version's format, a new one too; the version it had. Raises `FormatError`."""
    (found,) = database.execute("PRAGMA user_version").fetchone()
    version: int = found
    if version and not min(_STEPS) <= version <= VERSION:
        raise FormatError(version)
    steps = "".join(_STEPS[v] for v in range(version, VERSION)) if version else ""
    try:
        database.executescript(f"BEGIN IMMEDIATE; {steps} {DDL} PRAGMA user_version = {VERSION};")
        if 0 < version < _EPISODES:
            remake(database)
        database.execute("COMMIT")
    except sqlite3.Error:
        if database.in_transaction:
            database.execute("ROLLBACK")
        raise
    return version
