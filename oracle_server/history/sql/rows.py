"""What the history keeps, as rows of its tables, and back."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from operator import itemgetter
from typing import Any, cast, get_args

import msgspec

from oracle_server.core.bypass import Bypass
from oracle_server.core.events import Event, Order, Source, Step, StreamKey, TimeBase
from oracle_server.core.kinds import GOAL_ID, KINDS, STATUS
from oracle_server.core.verdicts import Decision, Outcome, json_number
from oracle_server.history.letters import LETTERS, letters
from oracle_server.history.query import Query
from oracle_server.history.records import Document, MonitorRecord, SessionRecord, SnapshotRecord, StoredStep
from oracle_server.history.sql.damage import readable
from oracle_server.history.sql.schema import STEP_COLUMNS
from oracle_server.history.sql.standing import (
    BYPASSED,
    degraded_of,
    outcomes_of,
    revised_of,
    revision_of,
    standing_columns,
    standing_of,
    whys_of,
    whys_text,
)

Row = tuple[Any, ...]

_UNNAMED: tuple[frozenset[str], tuple[Source, ...]] = frozenset(), ()
_UNREVISED: Mapping[int, int] = {}
_PLAIN = (None,) * 5
"""The columns of a step that was not revised."""
_TIME = "CASE WHEN skewed <> 0 THEN arrived ELSE stamp END"
"""Where a step stands in the order of publication, as `Step.time`."""

_NUMBERS = itemgetter(*map(STEP_COLUMNS.index, ("position", "seq", "gap", "stamp", "arrived", "judged", "lost")))
_ORDERS = frozenset(get_args(Order))
_NAMES = itemgetter(*map(STEP_COLUMNS.index, ("ord", "stream", "monitor", "source")))

_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.decode


def text(value: object) -> str:
    """A plain value as JSON."""
    return _encode(value).decode()


def step_row(session: int, stored: StoredStep) -> Row:
    """A step as a row of its table, in the order of `STEP_COLUMNS`."""
    step, event = stored.step, stored.step.event
    plain = stored.standing is None and stored.revision is None  # as nearly all are, and each is written
    return (
        session, stored.position, stored.order, _number(stored), event.stream.name, event.stream.kind, event.monitor,
        event.seq, stored.gap, step.stamp, event.arrived, stored.judged, int(step.late), int(step.skewed),
        int(step.forced), event.lost, event.source, event.call, int(event.ask),
        stored.decision.choice if stored.decision else None,
        text(stored.decision.denied_by) if stored.decision else "[]", stored.passed, stored.why,
        _encode(step.signals).decode(), "[]" if not step.failed else text(sorted(step.failed)),
        letters(stored.outcomes if plain else _told(stored)), _degraded(stored),
        whys_text(stored.explanations) if stored.explanations or (not plain and stored.tells_violations) else None,
        None if stored.robustness is None else text([json_number(value) for value in stored.robustness]),
        step.released, _streams_text(step.unheard, step.waited) if step.waited or step.unheard else None, stored.place,
        *(_PLAIN if plain else standing_columns(stored)),
        text({str(i): count for i, count in stored.pending.items()}) if stored.pending else None,
        event.row,
    )  # fmt: skip


@readable(lambda row: f"the step at position {row[1]} of session number {row[0]}")
def step_of(row: Row) -> StoredStep:
    """A row of the table of steps as what it was made of. Raises `HistoryError` where it is none."""
    r = dict(zip(STEP_COLUMNS, row, strict=True))
    signals, marks = _decode(r["signals"]), KINDS[r["kind"]].marks  # which stand among the signals
    _demand_sound(row, r, signals)
    event = Event(
        StreamKey(r["stream"], r["kind"]), r["monitor"], r["seq"], r["stamp"], r["arrived"], None, r["source"],
        r["call"], r["lost"], bool(r["ask"]), None, signals[GOAL_ID] if GOAL_ID in marks else None,
        signals[STATUS] if STATUS in marks else None, r["row"],
    )  # fmt: skip
    unheard, waited = _streams_of(r["unheard"]) if r["unheard"] else _UNNAMED
    step = Step(
        event, signals, frozenset(_decode(r["failed"])), r["stamp"], bool(r["skewed"]), bool(r["late"]),
        bool(r["forced"]), r["number"] is None, r["released"], unheard, waited,
    )  # fmt: skip
    revision = None if r["revision"] is None else revision_of(r["revision"])
    return StoredStep(
        r["position"], r["ord"], r["number"] or None, step, r["gap"], r["judged"],
        None if r["decision"] is None else Decision(r["decision"], tuple(_decode(r["denied_by"]))),
        () if revision else cast("tuple[Outcome, ...]", outcomes_of(r["outcomes"])), degraded_of(r["degraded"]),
        whys_of(r["explanations"]), _robustness(r["robustness"]), None if r["passed"] is None else bool(r["passed"]),
        r["why"], tuple([i for i, digit in enumerate(r["degraded"]) if digit == BYPASSED]), r["place"],
        None if r["standing"] is None else standing_of(r), revised_of(r["revised"]) if r["revised"] else _UNREVISED,
        revision,
        {int(i): count for i, count in _decode(r["pending"]).items()} if r["pending"] else {},
    )  # fmt: skip


def _demand_sound(row: Row, r: Mapping[str, Any], signals: object) -> None:
    """Raise ValueError for what SQLite gives, which knows no types, and nobody has written."""
    if {*map(type, _NUMBERS(row))} != {int} or {*map(type, _NAMES(row))} != {str} or not isinstance(signals, dict):
        raise ValueError("a value is of another type")
    if r["ord"] not in _ORDERS:
        raise ValueError("`ord` is none")
    if r["revision"] is None and len(r["outcomes"]) != len(r["degraded"]):
        raise ValueError("`outcomes` and `degraded` are of other properties")


@lru_cache(1_000)
def _streams_text(unheard: frozenset[str], waited: tuple[Source, ...]) -> str:
    """The names of streams that were not heard, with what was waited for beside them where there is any."""
    if not waited:
        return text(sorted(unheard))
    told = {"waited": [[monitor, *stream] for monitor, stream in waited]}
    return text({"unheard": sorted(unheard), **told} if unheard else told)


@lru_cache(1_000)
def _streams_of(kept: str) -> tuple[frozenset[str], tuple[Source, ...]]:
    """The same, back."""
    found = _decode(kept)
    if isinstance(found, list):
        return frozenset(found), ()
    waited = [(monitor, StreamKey(name, kind)) for monitor, name, kind in found.get("waited", ())]
    return frozenset(found.get("unheard", ())), tuple(waited)


def _told(stored: StoredStep) -> Sequence[Outcome | None]:
    """What a row can be searched by: a step's outcomes, or those to which a revision changes them."""
    if stored.revision is None:
        return stored.outcomes
    return [None if change is None else change.outcome for change in stored.revision.changes]


def _degraded(stored: StoredStep) -> str:
    if not stored.bypassed:
        return "".join(["1" if it else "0" for it in stored.degraded])
    marks = [BYPASSED if i in stored.bypassed else "1" if it else "0" for i, it in enumerate(stored.degraded)]
    return "".join(marks)


def _number(stored: StoredStep) -> int | None:
    """The step's number; 0 for an attempt that was taken back, None for what was not judged or is no event."""
    return 0 if stored.number is None and not stored.step.skipped and stored.step.event.monitor else stored.number


def _robustness(value: str | None) -> tuple[float | None, ...] | None:
    if value is None:
        return None
    return tuple([None if number is None else float(number) for number in _decode(value)])


def session_row(session: SessionRecord) -> Row:
    """A session as a row of its table, in the order of `SESSION_COLUMNS`."""
    return (*session[:5], text(session.properties), *session[6:])


@readable(lambda row: f"session number {row[0]}")
def session_of(row: Row) -> SessionRecord:
    """The same, back."""
    number, name, spec, yaml, digest, properties, private, *rest = row
    plain = number, name, spec, yaml, digest, _decode(properties), bool(private), *rest
    return msgspec.convert(plain, SessionRecord)


def monitor_row(session: int, monitor: MonitorRecord) -> Row:
    """A monitor as a row of its table, in the order of `MONITOR_COLUMNS`."""
    streams = text([list(key) for key in monitor.streams])
    bypasses = text([[*key, *bypass] for key, bypass in monitor.bypasses.items()])
    return session, monitor.name, monitor.instance, streams, monitor.attached, monitor.clock, bypasses, monitor.left


@readable(lambda row: f"monitor {row[1]} of session number {row[0]}")
def monitor_of(row: Row) -> MonitorRecord:
    """The same, back."""
    _, name, instance, streams, attached, clock, bypasses, left = row
    msgspec.convert((name, instance, attached, clock, left), tuple[str, str, int, TimeBase, int | None])
    keys = tuple(_decode(streams, type=list[StreamKey]))
    bypassed = {StreamKey(stream, kind): Bypass(told, since) for stream, kind, told, since in _decode(bypasses)}
    return MonitorRecord(name, instance, keys, bool(attached), clock, bypassed, left)


def snapshot_row(session: int, snapshot: SnapshotRecord) -> Row:
    """A snapshot as the session, its position, data, `settled` and numbers."""
    numbers = None if snapshot.numbers is None else text(snapshot.numbers)
    return session, snapshot.position, text(snapshot.data), snapshot.settled, numbers


@readable(lambda _: "a session's snapshot")
def snapshot_of(row: Row) -> SnapshotRecord:
    """A snapshot of its position, data, `settled` and numbers; data that is not JSON is None."""
    position, data, settled, numbers = row
    plain = None
    with contextlib.suppress(ValueError):
        plain = _decode(data)
    return SnapshotRecord(position, plain, settled, None if numbers is None else _decode(numbers))


@readable(lambda row: f"the state of session {row[1]}")
def document_of(row: Row) -> Document:
    """A plain document of its JSON, which the name of its session follows."""
    return _decode(row[0], type=Document)


def conditions(session: int, query: Query, lower: int, upper: int) -> tuple[str, list[object]]:
    """What the rows between two positions fulfil that may hold what a query asks for, and the values in it."""
    wanted: list[tuple[str, object]] = [("session = ?", session), ("position >= ?", lower), ("position <= ?", upper)]
    if query.stream is not None:
        wanted.append(("stream = ?", query.stream))
    if query.since is not None:
        wanted.append((f"{_TIME} >= ?", query.since))
    if query.until is not None:
        wanted.append((f"{_TIME} <= ?", query.until))
    if query.outcomes:
        column = "coalesce(standing, outcomes)" if query.view == "standing" else "outcomes"
        wanted.append((f"{column} GLOB '*' || ? || '*'", f"[{''.join(sorted(LETTERS[o] for o in query.outcomes))}]"))
    where = " AND ".join(condition for condition, _ in wanted)
    where += " AND explanations IS NOT NULL" * query.violations + " AND revision IS NULL" * (not query.revisions)
    return where, [value for _, value in wanted]
