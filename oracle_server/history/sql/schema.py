"""The tables of the history. One row a judged step: a property's verdict is one character of its `outcomes`."""

from __future__ import annotations

from oracle_server.core.errors import HistoryError

VERSION = 12
UNFINISHED = -VERSION
"""Instead of it while not all of another history is copied into this one: no server may begin with a part."""


class FormatError(HistoryError):
    """A history in a format that this version of the server does not read."""

    def __init__(self, version: int) -> None:
        super().__init__(
            "not all of another history is copied into this one yet: go on with `oracle-server history copy`"
            if version < 0
            else f"the history has format {version}, and this version of the server reads up to {VERSION}: "
            "go on with the newer one that has written it, or begin another history"
        )


DDL = """
CREATE TABLE IF NOT EXISTS sessions (
    number INTEGER PRIMARY KEY,
    id TEXT NOT NULL UNIQUE,
    spec TEXT NOT NULL,          -- the spec's id
    text TEXT NOT NULL,          -- its YAML, as opened
    digest TEXT NOT NULL,
    properties TEXT NOT NULL,    -- JSON: their ids, in the order of `outcomes`
    private INTEGER NOT NULL,    -- closed with its last monitor
    opened INTEGER NOT NULL,     -- ns
    asked TEXT,                  -- the order that was asked for instead of the spec's
    begun INTEGER,               -- ns, in the session's own time: when its first monitor attached
    decides TEXT NOT NULL DEFAULT 'publication',  -- the order whose steps are decided by
    closed INTEGER,              -- ns
    kind TEXT NOT NULL DEFAULT 'robot',  -- or recording: what it judges
    state TEXT                   -- JSON: how it stood when it was closed; if open, its `trouble`
);
CREATE TABLE IF NOT EXISTS steps (
    session INTEGER NOT NULL,
    position INTEGER NOT NULL,   -- 1, 2, 3…: the sequence in which the session judged
    ord TEXT NOT NULL,
    number INTEGER,              -- the step; NULL where none was judged, and for ticks; 0 for an attempt taken back
    stream TEXT NOT NULL,        -- empty for ticks and revisions, as is their monitor
    kind TEXT NOT NULL,
    monitor TEXT NOT NULL,
    seq INTEGER NOT NULL,
    gap INTEGER NOT NULL,        -- sequence numbers before it that never came
    stamp INTEGER NOT NULL,      -- ns
    arrived INTEGER NOT NULL,    -- ns
    judged INTEGER NOT NULL,     -- ns
    late INTEGER NOT NULL,
    skewed INTEGER NOT NULL,
    forced INTEGER NOT NULL,
    lost INTEGER NOT NULL,
    source TEXT NOT NULL,
    call INTEGER,
    ask INTEGER NOT NULL,
    decision TEXT,
    denied_by TEXT NOT NULL,     -- JSON: the denying properties
    passed INTEGER,
    why TEXT,
    signals TEXT NOT NULL,       -- JSON
    failed TEXT NOT NULL,        -- JSON
    outcomes TEXT NOT NULL,      -- a character a property: T t f F u
    degraded TEXT NOT NULL,      -- a character a property: 0, 1, or 2 for one that is only while a stream is bypassed
    explanations TEXT,           -- JSON, by the property's place; NULL where none became negative, nor any stands so
    robustness TEXT,             -- JSON: a number, "Infinity", "-Infinity" or null a property; NULL where there is none
    released TEXT,               -- why the order of publication released it: frontier, clock, max_delay or capacity
    unheard TEXT,                -- JSON: streams not heard beyond it, or an object with what it `waited` for; or NULL
    place INTEGER,               -- among the steps, of a late event that was put there
    standing TEXT,               -- as `outcomes`, since it was revised; -: the deadline is retracted
    standing_degraded TEXT,      -- as `degraded`, since it was revised
    standing_explanations TEXT,  -- as `explanations`, since it was revised
    revised TEXT,                -- JSON, by the property's place: the number of the revision by which it stands so
    revision TEXT,               -- JSON, of a revision: what it changes, and because of which late events
    pending TEXT,                -- JSON, by the property's place: open obligations; NULL where no property has any
    row INTEGER,                 -- which element of its message, from 0; NULL where that is one step
    PRIMARY KEY (session, position)
) WITHOUT ROWID;
CREATE UNIQUE INDEX IF NOT EXISTS steps_by_seq ON steps (session, monitor, seq, ord, coalesce(row, -1));
CREATE INDEX IF NOT EXISTS violations ON steps (session, position) WHERE explanations IS NOT NULL;
CREATE TABLE IF NOT EXISTS blocks (
    session INTEGER NOT NULL,
    level INTEGER NOT NULL,      -- 0: of 32 positions; each further one: of 8 blocks of the level below
    block INTEGER NOT NULL,      -- 0, 1, 2… in each level, from position 1 on
    since INTEGER NOT NULL,      -- ns: the time of its first step
    until INTEGER NOT NULL,      -- ns: that of its last step
    worst TEXT NOT NULL,         -- a character a property, as `outcomes` of steps; empty where no row counts
    degraded TEXT NOT NULL,      -- a character a property: 0 or 1
    data TEXT NOT NULL,          -- JSON: what is counted, and sketches of signals
    PRIMARY KEY (session, level, block)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS episodes (
    session INTEGER NOT NULL,
    property TEXT NOT NULL,      -- its id
    first INTEGER NOT NULL,      -- the number of the verdict that violates first
    ord TEXT NOT NULL,
    began INTEGER NOT NULL,      -- ns
    last INTEGER NOT NULL,       -- the number of the verdict that violates last; as of the last change while it is open
    until INTEGER NOT NULL,      -- ns: its time, likewise
    open INTEGER NOT NULL,
    final INTEGER NOT NULL,
    count INTEGER NOT NULL,      -- violations
    worst TEXT,                  -- JSON: the least robustness, or the value furthest from its bound
    explanation TEXT,            -- the text of that of the first violation
    PRIMARY KEY (session, property, first)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS episodes_by_time ON episodes (began, session, property, first);
CREATE INDEX IF NOT EXISTS episodes_of ON episodes (session, property, began, open, final);
CREATE INDEX IF NOT EXISTS episodes_open ON episodes (began, session, property, first) WHERE open;
CREATE TABLE IF NOT EXISTS forgotten (  -- by retention, of what episodes tell
    session INTEGER NOT NULL,
    property TEXT NOT NULL,      -- its id
    ord TEXT NOT NULL,
    upto INTEGER NOT NULL,       -- `first` of the last episode that was deleted
    count INTEGER NOT NULL,      -- violations of all episodes up to that one
    first INTEGER NOT NULL,      -- the number of the first of these
    PRIMARY KEY (session, property, ord)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS monitors (
    session INTEGER NOT NULL,
    name TEXT NOT NULL,
    instance TEXT NOT NULL,
    streams TEXT NOT NULL,       -- JSON: [name, kind] of those that it claimed
    attached INTEGER NOT NULL,
    clock TEXT NOT NULL,         -- wall or sim
    bypasses TEXT NOT NULL DEFAULT '[]',  -- JSON: [name, what is told of it, since (ns)] of streams that are bypassed
    left_at INTEGER,             -- ns: when it was detached, NULL where it is not
    PRIMARY KEY (session, name)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS snapshots (
    session INTEGER PRIMARY KEY,
    position INTEGER NOT NULL,   -- of the last step before it
    data TEXT NOT NULL,          -- JSON
    settled INTEGER NOT NULL,    -- steps up to this position are needed no more; 0 where all are
    numbers TEXT                 -- JSON, by monitor: its numbers, as of `settled`
);
CREATE TABLE IF NOT EXISTS refused (
    session INTEGER NOT NULL,
    monitor TEXT NOT NULL,
    seq INTEGER NOT NULL,
    gap INTEGER NOT NULL,
    at INTEGER NOT NULL,         -- ns
    code TEXT NOT NULL,
    message TEXT NOT NULL,
    PRIMARY KEY (session, monitor, seq)
) WITHOUT ROWID;
"""

STEP_COLUMNS = (
    "session", "position", "ord", "number", "stream", "kind", "monitor", "seq", "gap", "stamp", "arrived", "judged",
    "late", "skewed", "forced", "lost", "source", "call", "ask", "decision", "denied_by", "passed", "why", "signals",
    "failed", "outcomes", "degraded", "explanations", "robustness", "released", "unheard", "place", "standing",
    "standing_degraded", "standing_explanations", "revised", "revision", "pending", "row",
)  # fmt: skip
REFUSED_COLUMNS = ("session", "monitor", "seq", "gap", "at", "code", "message")
SESSION_COLUMNS = (
    "number", "id", "spec", "text", "digest", "properties", "private", "opened", "asked", "begun", "decides", "kind",
)  # fmt: skip
MONITOR_COLUMNS = ("session", "name", "instance", "streams", "attached", "clock", "bypasses", "left_at")
