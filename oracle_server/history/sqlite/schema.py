"""The tables of the history. One row a judged step: a property's verdict is one character of its `outcomes`."""

from __future__ import annotations

from typing import Any

import msgspec

from oracle_server.core.events import Event, Order, Step, StreamKey
from oracle_server.core.verdicts import UNDECIDED, Judged, Outcome, explain, json_number

VERSION = 5

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
    closed INTEGER,              -- ns
    state TEXT                   -- JSON: how it stood when it was closed
);
CREATE TABLE IF NOT EXISTS steps (
    session INTEGER NOT NULL,
    position INTEGER NOT NULL,   -- 1, 2, 3…: the sequence in which the session judged
    ord TEXT NOT NULL,
    number INTEGER,              -- the step; NULL for ticks, and where it was skipped
    stream TEXT NOT NULL,        -- empty for ticks, as is their monitor
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
    degraded TEXT NOT NULL,      -- a character a property: 0 1
    explanations TEXT,           -- JSON, by the property's place; NULL where none became negative
    robustness TEXT,             -- JSON: a number, "Infinity", "-Infinity" or null a property; NULL where there is none
    PRIMARY KEY (session, position)
) WITHOUT ROWID;
CREATE UNIQUE INDEX IF NOT EXISTS steps_by_seq ON steps (session, monitor, seq, ord);
CREATE INDEX IF NOT EXISTS violations ON steps (session, position) WHERE explanations IS NOT NULL;
CREATE TABLE IF NOT EXISTS monitors (
    session INTEGER NOT NULL,
    name TEXT NOT NULL,
    instance TEXT NOT NULL,
    streams TEXT NOT NULL,       -- JSON: [name, kind] of those that it claimed
    attached INTEGER NOT NULL,
    clock TEXT NOT NULL,         -- wall or sim
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
    "failed", "outcomes", "degraded", "explanations", "robustness",
)  # fmt: skip
REFUSED_COLUMNS = ("session", "monitor", "seq", "gap", "at", "code", "message")

LETTERS = {
    Outcome.TRUE: "T",
    Outcome.CURRENTLY_TRUE: "t",
    Outcome.CURRENTLY_FALSE: "f",
    Outcome.FALSE: "F",
    Outcome.UNKNOWN: "u",
}
OUTCOMES = {letter: outcome for outcome, letter in LETTERS.items()}

Row = tuple[Any, ...]
_encode = msgspec.json.Encoder().encode


def step_row(session: int, position: int, gap: int, judged: Judged, outcome: tuple[bool, str] | None) -> Row:
    """A judged step as a row; `outcome` is what the adapter did and why, where it has said so already."""
    step, event = judged.step, judged.step.event
    passed, why = outcome or (None, None)
    return (
        session, position, judged.order, judged.number, event.stream.name, event.stream.kind, event.monitor, event.seq,
        gap, step.stamp, event.arrived, judged.judged, step.late, step.skewed, step.forced, event.lost, event.source,
        event.call, event.ask, judged.decision.choice if judged.decision else None,
        _encode(judged.decision.denied_by).decode() if judged.decision else "[]", passed, why,
        _encode(step.signals).decode(), "[]" if not step.failed else _encode(sorted(step.failed)).decode(),
        "".join([LETTERS[v.outcome] for v in judged.verdicts]),
        "".join(["1" if v.degraded else "0" for v in judged.verdicts]), _explanations(judged),
        _robustness(judged),
    )  # fmt: skip


def _explanations(judged: Judged) -> str | None:
    found = {str(i): explain(judged, v) for i, v in enumerate(judged.verdicts) if v.explanation is not None}
    return _encode(found).decode() if found else None


def _robustness(judged: Judged) -> str | None:
    if all(v.robustness is None for v in judged.verdicts):
        return None
    return _encode([json_number(v.robustness) for v in judged.verdicts]).decode()


def step_of(row: Row) -> tuple[Order, Step, int]:
    """A stored step, ready to be judged again: its order, itself, and when it was judged."""
    r = dict(zip(STEP_COLUMNS, row, strict=True))
    event = Event(
        StreamKey(r["stream"], r["kind"]), r["monitor"], r["seq"], r["stamp"], r["arrived"], None, r["source"],
        r["call"], r["lost"], bool(r["ask"]),
    )  # fmt: skip
    step = Step(
        event, msgspec.json.decode(r["signals"]), frozenset(msgspec.json.decode(r["failed"])), r["stamp"],
        bool(r["skewed"]), bool(r["late"]), bool(r["forced"]), r["number"] is None,
    )  # fmt: skip
    return r["ord"], step, r["judged"]


def records_of(row: Row, properties: list[str]) -> list[dict[str, Any]]:
    """The verdict records of a stored step, one a property."""
    r = dict(zip(STEP_COLUMNS, row, strict=True))
    explanations = msgspec.json.decode(r["explanations"]) if r["explanations"] else {}
    robustness = msgspec.json.decode(r["robustness"]) if r["robustness"] else [None] * len(properties)
    first = (r["position"] - 1) * len(properties) + 1
    return [
        {
            "n": first + i,
            "step": r["number"],
            "property": name,
            "order": r["ord"],
            "outcome": OUTCOMES[r["outcomes"][i]].value,
            "stream": r["stream"],
            "kind": "unavailable" if r["why"] in UNDECIDED else r["kind"],
            "monitor": r["monitor"],
            "seq": r["seq"],
            "stamp": r["stamp"],
            "arrived": r["arrived"],
            "judged": r["judged"],
            "late": bool(r["late"]),
            "skewed": bool(r["skewed"]),
            "degraded": r["degraded"][i] == "1",
            "decision": r["decision"],
            "passed": None if r["passed"] is None else bool(r["passed"]),
            "robustness": robustness[i],
            "violation": str(i) in explanations,
            "explanation": explanations.get(str(i)),
        }
        for i, name in enumerate(properties)
    ]
