"""What a robot's history keeps for its forwarding: which rows were changed, and how far the centre is known to be.

Steps are numbered, so that those that are new need no notice; all else that is new or changed is noted by triggers, in
the transaction that changes it. A row is noted once, behind all others, however often it was changed.
"""

from __future__ import annotations

import secrets

from oracle_server.history.blocks import LEVELS, positions
from oracle_server.history.copying.tables import tables
from oracle_server.history.sql.database import Database

GONE = "gone"
"""Instead of a table's name: an episode that was taken back. One that retention deletes is not noted."""
_TABLES = """
CREATE TABLE IF NOT EXISTS forwarding (
    robot TEXT NOT NULL,         -- this history, by a number of its own
    seq INTEGER NOT NULL         -- the last change that the centre has
);
CREATE TABLE IF NOT EXISTS forwarded (
    session INTEGER PRIMARY KEY,
    position INTEGER NOT NULL    -- of the last step that the centre has
);
CREATE TABLE IF NOT EXISTS changes (
    seq INTEGER PRIMARY KEY AUTOINCREMENT,
    name TEXT NOT NULL,          -- the table
    session INTEGER NOT NULL,
    a NOT NULL,                  -- what else the row's key has; empty where there is no more
    b NOT NULL,
    UNIQUE (name, session, a, b)
);
"""
LEFT_OUT = ("snapshots",)
"""Tables that only the robot's server needs."""
_TRIGGER = """
CREATE TRIGGER IF NOT EXISTS {table}_{event}_noted AFTER {event} ON {table} BEGIN
    DELETE FROM changes WHERE name = '{table}' AND session = NEW.{key} AND a = {a} AND b = {b};
    INSERT INTO changes (name, session, a, b) VALUES ('{table}', NEW.{key}, {a}, {b});
END;
"""
_FORGOTTEN = """
CREATE TRIGGER IF NOT EXISTS {table}_delete_noted AFTER DELETE ON {table} BEGIN
    DELETE FROM changes WHERE name = '{table}' AND session = OLD.{key} AND a = {a} AND b = {b};
END;
"""
"""Nothing can be brought of a row that retention has deleted: without this, notes of a history that is forwarded no
longer would grow for ever."""
_EACH = "SELECT json_extract(value, '$[0]'), json_extract(value, '$[1]'), json_extract(value, '$[2]') FROM json_each(?)"
NOTE_GONE = (
    f"DELETE FROM changes WHERE name = 'gone' AND (session, a, b) IN ({_EACH})",  # noqa: S608
    f"INSERT INTO changes (name, session, a, b) SELECT 'gone', * FROM ({_EACH})",  # noqa: S608
)
"""Note episodes that were taken back, given as one text."""
IS_NOTED = "SELECT 1 FROM sqlite_master WHERE name = 'forwarding'"
STANDS = "SELECT robot, seq FROM forwarding"
ACKED = "UPDATE forwarding SET seq = ?"
FORGET = "DELETE FROM changes WHERE seq <= ?"
REACHED = (
    "INSERT INTO forwarded VALUES (?, ?) ON CONFLICT (session) DO UPDATE SET position = excluded.position "
    "WHERE excluded.position > forwarded.position"
)
_WIDTHS = " ".join(f"WHEN {level} THEN {positions(level)}" for level in range(LEVELS))
FREE = f"""
SELECT s.number, coalesce(f.position, 0),
    (SELECT min(a) - 1 FROM changes WHERE name = 'steps' AND session = s.number),
    (SELECT min(b * CASE a {_WIDTHS} END) FROM changes WHERE name = 'blocks' AND session = s.number),
    (SELECT min((e.last - 1) / json_array_length(s.properties))
        FROM changes c JOIN episodes e ON e.session = c.session AND e.property = c.a AND e.first = c.b
        WHERE c.name = 'episodes' AND c.session = s.number AND NOT e.open),
    EXISTS (SELECT 1 FROM changes WHERE session = s.number
        AND name IN ('sessions', 'steps', 'blocks', 'episodes', 'forgotten', 'refused', 'monitors', 'gone'))
FROM sessions s LEFT JOIN forwarded f ON f.session = s.number
"""  # noqa: S608 -- no value is in it
"""Of each session the last step that the centre has; the last one that can be deleted without what has changed since:
steps, blocks, and episodes that have ended; and whether anything has."""
BEHIND = """
SELECT coalesce(f.position, 0), coalesce((SELECT min(position) FROM steps WHERE session = s.number), 1),
    coalesce((SELECT max(position) FROM steps WHERE session = s.number), 0), (
        SELECT judged FROM steps WHERE session = s.number AND position > coalesce(f.position, 0)
        ORDER BY position LIMIT 1
    )
FROM sessions s LEFT JOIN forwarded f ON f.session = s.number
"""
"""Of each session the last step that the centre has, the first and last ones here, and when the next one was judged."""
UNTOLD = "SELECT count(*) FROM changes WHERE seq > (SELECT seq FROM forwarding)"
FORGET_SESSION = "DELETE FROM changes WHERE session = ?"
LAST_NUMBER = "SELECT max(coalesce(max(number), 0), coalesce((SELECT max(session) FROM forwarded), 0)) FROM sessions"
"""Numbers of sessions that the centre has are never given again."""


def begin(database: Database) -> None:
    """Note changes from now on, within a transaction; all that is there counts as changed if none were noted before."""
    noted = database.execute(IS_NOTED).fetchone()
    for statement in (*filter(str.strip, _TABLES.split(";\n")), *_triggers()):
        database.execute(statement)
    if not noted:
        for statement in beginning_anew(known=False):
            database.execute(statement)


def beginning_anew(*, known: bool) -> list[str]:
    """Statements that have all forwarded from the beginning; as the same history where the centre `known` has some."""
    other = ["DELETE FROM forwarding", f"INSERT INTO forwarding VALUES ('{secrets.token_hex(16)}', 0)"]  # noqa: S608
    made = [
        *(["UPDATE forwarding SET seq = 0"] if known else other),
        "DELETE FROM forwarded",
        "INSERT INTO forwarded SELECT number, 0 FROM sessions",
    ]
    for table, key, a, b in _noted():
        if table != "steps":
            made.append(f"DELETE FROM changes WHERE name = '{table}'")  # noqa: S608
            made.append(f"INSERT INTO changes (name, session, a, b) SELECT '{table}', {key}, {a}, {b} FROM {table}")  # noqa: S608
    return made


def _noted() -> list[tuple[str, str, str, str]]:
    """The tables that are forwarded, and what their rows are told by."""
    found = []
    for table in tables():
        if table.name not in LEFT_OUT:
            key, *more = table.columns[: table.keys]
            a, b = [*more, "''", "''"][:2]
            found.append((table.name, key, a, b))
    return found


def _triggers() -> list[str]:
    made = []
    for table, key, *more in _noted():
        a, b = [each if each == "''" else f"NEW.{each}" for each in more]
        events = ("UPDATE",) if table == "steps" else ("INSERT", "UPDATE")
        made += [_TRIGGER.format(table=table, event=event, key=key, a=a, b=b) for event in events]
        made.append(_FORGOTTEN.format(table=table, key=key, a=a.replace("NEW.", "OLD."), b=b.replace("NEW.", "OLD.")))
    return made
