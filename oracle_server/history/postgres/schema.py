"""The tables in a database, in this version's format; whether the server's settings keep what is committed."""

from __future__ import annotations

from collections.abc import Iterable

import structlog

from oracle_server.core.errors import HistoryError, UnansweredError
from oracle_server.history.postgres.connection import Connection
from oracle_server.history.postgres.dialect import tables
from oracle_server.history.sql.schema import VERSION, FormatError
from oracle_server.history.sql.statements import OF_A_SESSION

FIRST = 10
"""The first format that was ever kept in PostgreSQL."""
_STEPS = {
    10: "ALTER TABLE steps ADD COLUMN IF NOT EXISTS row BIGINT; DROP INDEX IF EXISTS steps_by_seq;",
    11: "",  # tables that are new are made for all
}
"""By the version that they start from: statements that lead to the next one."""
_LOCK = 7_215_642_218
"""A number for the lock under which tables are made."""
_OWN = """
CREATE TABLE IF NOT EXISTS format (version BIGINT NOT NULL);
CREATE TABLE IF NOT EXISTS nodes (
    node TEXT COLLATE "C" PRIMARY KEY,
    owner TEXT NOT NULL,         -- a process, by a number of its own
    epoch BIGINT NOT NULL,       -- of its connections: what is written with an older one is refused
    until TIMESTAMPTZ NOT NULL,  -- by the database's clock
    batch BIGINT NOT NULL,       -- the last one that was committed
    place TEXT NOT NULL,         -- host and process, for people
    url TEXT                     -- where monitors reach it
);
ALTER TABLE nodes ADD COLUMN IF NOT EXISTS url TEXT;
CREATE SEQUENCE IF NOT EXISTS session_numbers;
CREATE TABLE IF NOT EXISTS owners (  -- of sessions that are open, or about to be
    session BIGINT PRIMARY KEY DEFAULT nextval('session_numbers'),
    id TEXT COLLATE "C" NOT NULL UNIQUE,
    node TEXT COLLATE "C" NOT NULL
);
CREATE INDEX IF NOT EXISTS owners_by_node ON owners (node);
"""
_FORWARDED = """
CREATE TABLE IF NOT EXISTS origins (
    origin TEXT COLLATE "C" NOT NULL,
    robot TEXT COLLATE "C" NOT NULL,   -- the robot's history, by a number of its own
    writer TEXT COLLATE "C" NOT NULL,  -- the process that brings it: what an older one writes is refused
    seq BIGINT NOT NULL,               -- the last change of it that is there
    heard TIMESTAMPTZ NOT NULL DEFAULT clock_timestamp(),
    PRIMARY KEY (origin, robot)
);
CREATE TABLE IF NOT EXISTS forwarded (
    session BIGINT PRIMARY KEY,
    origin TEXT COLLATE "C" NOT NULL,
    robot TEXT COLLATE "C" NOT NULL,
    number BIGINT NOT NULL,            -- of the session, at the robot
    position BIGINT NOT NULL,          -- of its last step that is there
    gaps TEXT NOT NULL,                -- JSON: the first and last positions that were deleted before they came
    own TEXT COLLATE "C",              -- the session's name at the robot
    continued TEXT COLLATE "C",        -- the name there of the one that goes on with it, where that is not here yet
    opened BIGINT,                     -- ns, as the session's, which may be deleted
    ended BIGINT,                      -- ns, by this database's clock: when it came that the session is closed
    UNIQUE (origin, robot, number)
);
ALTER TABLE forwarded ADD COLUMN IF NOT EXISTS own TEXT COLLATE "C";
ALTER TABLE forwarded ADD COLUMN IF NOT EXISTS continued TEXT COLLATE "C";
ALTER TABLE forwarded ADD COLUMN IF NOT EXISTS opened BIGINT;
ALTER TABLE forwarded ADD COLUMN IF NOT EXISTS ended BIGINT;
UPDATE forwarded SET opened = s.opened FROM sessions s WHERE s.number = session AND forwarded.opened IS NULL;
"""
"""Of sessions that robots forward: each chunk is one transaction with how far it is."""
TAKES_FORWARDED = """
SELECT count(*) = 4 FROM pg_attribute
WHERE attrelid = to_regclass('forwarded') AND attname IN ('own', 'continued', 'opened', 'ended') AND NOT attisdropped
"""
"""Whether that table is as it is now: a version before this one made it otherwise in the same format."""
_BEHIND = "ALTER TABLE origins ADD COLUMN behind TEXT"
"""JSON: who wrote it, the rows that were still to come then, and when the oldest step of them was judged (ns)."""
TELLS_BEHIND = (
    "SELECT EXISTS (SELECT 1 FROM pg_attribute "
    "WHERE attrelid = to_regclass('origins') AND attname = 'behind' AND NOT attisdropped)"
)
"""Whether the centre was used by a version that has it: robots of older ones write the table, too."""
_THERE = """
SELECT set_config('search_path', relnamespace::regnamespace || ', ' || current_setting('search_path'), true)
FROM pg_class WHERE oid = to_regclass('sessions')
"""
"""New tables are made where the others are: a schema before that one may have been made later."""
_AS_OWNER = """
SELECT set_config('role', rolname, true) FROM pg_database JOIN pg_roles ON pg_roles.oid = datdba
WHERE datname = current_database() AND pg_has_role(datdba, 'MEMBER')
    AND has_schema_privilege(datdba, current_schema(), 'CREATE')
"""
"""Until the transaction ends, where that may be: a robot that comes first would keep all others from its tables."""
_MISSING = "SELECT name FROM unnest(?::text[]) AS name WHERE to_regclass(name) IS NULL ORDER BY name"
_ADDED = "forgotten"
"""The table that an older format does not have."""
_SHARE = """
INSERT INTO owners (session, id, node)
SELECT number, id, 'server' FROM sessions
WHERE closed IS NULL AND id NOT LIKE '%@%' AND NOT EXISTS (SELECT 1 FROM owners WHERE session = number)
ON CONFLICT DO NOTHING
"""
"""What a server had that held its database alone is its own, by the name that each of these had; so is what nobody has,
since only a part of a backup was put back. What robots forward is theirs."""
_LEFT = """
INSERT INTO nodes (node, owner, epoch, until, batch, place)
SELECT DISTINCT node, '', 1, '-infinity'::timestamptz, 0, 'not known' FROM owners
WHERE NOT EXISTS (SELECT 1 FROM nodes WHERE nodes.node = owners.node) ON CONFLICT DO NOTHING
"""
"""Else nobody would take over from them. One that is there is left alone: who stands still may have its row locked."""
COUNT_ON = """
SELECT setval('session_numbers', last.number)
FROM (
    SELECT greatest((SELECT max(number) FROM sessions), (SELECT max(session) FROM forwarded)) AS number
) AS last, session_numbers AS counter
WHERE last.number > counter.last_value OR (last.number = counter.last_value AND NOT counter.is_called)
"""
"""Numbers that were given before there was a counter, or in the history of which this is a copy."""
_SETTINGS = ("fsync", "full_page_writes", "synchronous_commit")
_STANDBYS = "SELECT count(*) FROM pg_stat_replication WHERE sync_state IN ('sync', 'quorum')"

log = structlog.get_logger()


def prepare(database: Connection) -> None:
    """Make the tables, or bring them to this version's format. Raises `HistoryError`, `FormatError` of a newer one."""
    check(database)
    database.execute("BEGIN")
    try:
        database.execute("SELECT pg_advisory_xact_lock(?)", (_LOCK,))  # two servers may begin at once
        database.execute(_THERE)
        shared = not _missing(database, ["format", "nodes", "owners"])
        if len(_missing(database, ["format", "sessions"])) == 2:
            database.execute(_AS_OWNER)
        found = database.execute("SELECT version FROM format").fetchone() if shared else None
        _demand_all(database, found)
        version = VERSION
        if found is None or found[0] != VERSION:  # else nothing is locked that servers write which run
            database.execute(_OWN)
            version = _migrated(database)
            database.execute(_FORWARDED)
        database.execute(_SHARE)
        database.execute(_LEFT)
        if not database.execute(TAKES_FORWARDED).fetchone()[0]:
            database.execute(_FORWARDED)
        if not database.execute(TELLS_BEHIND).fetchone()[0]:
            _tell_behind(database)
        database.execute(COUNT_ON)
        database.commit()
    except BaseException:
        database.rollback()
        raise
    if version != VERSION:
        log.info("the history was migrated to a newer format", was=version, now=VERSION)


def _missing(database: Connection, tables: Iterable[str]) -> list[str]:
    return [name for (name,) in database.execute(_MISSING, (f"{{{','.join(tables)}}}",)).fetchall()]


def _demand_all(database: Connection, found: tuple[int] | None) -> None:
    """Raise `HistoryError` where there is a history of which some tables are missing: empty ones would tell nothing."""
    names = {name for name, _ in OF_A_SESSION} - ({_ADDED} if found is None or found[0] < VERSION else set())
    missing = _missing(database, names)
    if "sessions" not in missing and missing:
        raise HistoryError(
            f"of the history's tables these are missing: {', '.join(missing)}; put all of its backup back, or make an "
            "empty database"
        )


def _tell_behind(database: Connection) -> None:
    """Add what is only told to people, unless that fails: the role may not own the table, or a backup may read it."""
    database.execute("SAVEPOINT behind")
    try:
        database.execute("SET LOCAL lock_timeout = '1s'")  # who comes behind who waits for this lock waits, too
        database.execute(_BEHIND)
    except UnansweredError:
        raise
    except HistoryError as error:
        database.execute("ROLLBACK TO behind")
        log.warning("it is not told which robots are catching up, until a server starts that can", reason=str(error))


def _migrated(database: Connection) -> int:
    found = database.execute("SELECT version FROM format").fetchone()
    version: int = VERSION if found is None else found[0]
    if not FIRST <= version <= VERSION:
        raise FormatError(version)
    for step in range(version, VERSION):
        database.execute(_STEPS[step])
    database.execute(tables())
    sql = "INSERT INTO format VALUES (?)" if found is None else "UPDATE format SET version = ?"
    database.execute(sql, (VERSION,))
    return version


def check(database: Connection) -> None:
    """Raise `HistoryError` where a commit may be lost, or texts may be changed; log whether a standby has it too.

    A pooler that lies between is warned of: it has numbers of its own for connections.
    """
    for name in _SETTINGS:
        (value,) = database.execute("SELECT current_setting(?)", (name,)).fetchone()
        if value == "off":
            raise HistoryError(
                f"PostgreSQL has {name} = off: what is acked could be lost; set {name} = on in postgresql.conf, or for "
                "the role or database"
            )
    (encoding,) = database.execute("SELECT current_setting('server_encoding')").fetchone()
    if encoding != "UTF8":
        raise HistoryError(f"the database has the encoding {encoding}: make one with ENCODING 'UTF8'")
    (pid,) = database.execute("SELECT pg_backend_pid()").fetchone()
    if pid != database.raw.info.backend_pid:
        log.warning(
            "between this server and PostgreSQL is a pooler: connect to PostgreSQL itself, or have it keep a "
            "connection for each client (pool_mode = session)"
        )
    (waits,) = database.execute("SELECT current_setting('synchronous_commit')").fetchone()
    (names,) = database.execute("SELECT current_setting('synchronous_standby_names')").fetchone()
    (standbys,) = database.execute(_STANDBYS).fetchone()
    if names and standbys and waits != "local":
        log.info("the history is committed on a standby too", standbys=standbys)
    else:
        log.info("the history has no synchronous standby: what is acked ends with PostgreSQL's disk")
