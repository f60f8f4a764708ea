"""A session's state in short, for pages: what has changed of it, and what a list of many shows."""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from typing import Any

from oracle_server.core.judging.asked import briefly
from oracle_server.core.judging.asked import told as told_idle
from oracle_server.core.units import counted
from oracle_server.core.verdicts import Outcome, worst
from oracle_server.history.records import Document

_ROWS = {"properties": ("id", "order"), "streams": ("monitor", "stream", "kind"), "monitors": ("name",)}
"""The lists of a state, and what tells their rows apart."""
_PLACES = {key: itemgetter(*names) for key, names in _ROWS.items()}
"""The same of a row, to be compared."""

_BRIEF = (
    "id", "spec", "kind", "origin", "run", "status", "live", "idle", "without_monitor_since", "clock", "opened",
    "closed", "closed_because", "continued_by", "trouble",
)  # fmt: skip

LISTED = 1_000
"""Closed sessions that are listed at the most."""
WHY_DEGRADED = "what came before was lost, skipped, not computed or judged too early"
"""Why verdicts are degraded for good, where nothing tells more."""
_FEW = 3
"""Caveats, and doubts, that a list shows of a session."""


def told(state: Document) -> Document:
    """A session's state as clients are told it: with `doubts` and `remarks`, also where an older version kept it."""
    return state | {"doubts": [*dict.fromkeys(_doubts(state))], "remarks": [*_remarks(state)]}


def _remarks(state: Document) -> Iterator[str]:
    """That nothing was asked of properties, so that it tells nothing that they hold."""
    yield from told_idle([*_idle(state).items()])


def idle(state: Document) -> str:
    """The same for a list of many sessions; empty where something was asked of each, or an older server tells it."""
    return briefly([*_idle(state)])


def _idle(state: Document) -> dict[str, str]:
    """What never held of the properties of which nothing was asked, by their names."""
    return {row["id"]: row["unasked"] for row in state["properties"] if row.get("unasked")}


def summary(state: Document) -> Document:
    """A session's state without what changes with time alone, and what is long: `lag` of streams, and `hold`."""
    short = {key: value for key, value in state.items() if key != "hold"}
    short["streams"] = [{k: v for k, v in row.items() if k != "lag"} for row in state["streams"]]
    return short


def changed(before: Document, now: Document) -> Document:
    """The keys of a summary that are not as they were before, of lists the rows that are not; those that are `gone`."""
    news = {key: _news(key, before, value) for key, value in now.items() if key not in before or before[key] != value}
    gone = {key: rows for key in _ROWS if key in news and (rows := _gone(key, before, now))}
    return news | ({"gone": gone} if gone else {})


def _gone(key: str, before: Document, now: Document) -> list[Document]:
    """What tells the rows apart that are not there any more."""
    place = _PLACES[key]
    there = {*map(place, now[key])}
    return [{name: row[name] for name in _ROWS[key]} for row in before.get(key, ()) if place(row) not in there]


def _news(key: str, before: Document, value: Any) -> Any:
    place = _PLACES.get(key)
    if place is None or key not in before:
        return value
    known = {place(row): row for row in before[key]}
    return [row for row in value if known.get(place(row)) != row]


def brief(state: Document) -> Document:
    """What a list of many sessions shows of a state, which an older version may have kept: a tenth of it.

    Where nothing is known of its properties, as of one that could not be restored, `outcome` and `violations` are None.
    """
    kept = {key: state.get(key) for key in _BRIEF}
    properties, monitors = state["properties"], state["monitors"]
    return kept | {
        "outcome": worst(Outcome(row["outcome"]) for row in properties).value if properties else None,
        "violations": sum(row["violations"] for row in properties) if properties else None,
        "steps": state["counters"]["steps"],
        "monitors": len(monitors),
        "connected": sum(bool(row["connected"]) for row in monitors),
        "caveats": [*dict.fromkeys(_caveats(state))][:_FEW],
        "doubts": [*dict.fromkeys(_doubts(state))][:_FEW],
        "unasked": idle(state) or None,
    }


def stream_troubles(state: Document) -> Iterator[str]:
    """What monitors report of the streams of an open session; a bypass is told by the properties that it concerns."""
    for monitor in state["monitors"] if state["status"] == "open" else ():
        for told in monitor["streams"] if monitor["attached"] else ():
            if told["trouble"] and not told.get("bypass"):
                yield f"{told['stream']}: {told['trouble']}"


def _caveats(state: Document) -> Iterator[str]:
    """Why what is told of a session's properties may be wrong at present, though nothing is violated."""
    if state["status"] == "open":
        for row in state["properties"]:
            yield from row["caveats"]
    yield from stream_troubles(state)


def _doubts(state: Document) -> Iterator[str]:
    """Why what is told of a session may be wrong for good: something was not heard, or not judged."""
    if state.get("recording"):
        yield from _doubts_of_recording(state)
        return
    counters = state["counters"]
    if lost := counters.get("lost"):
        places = ", ".join(dict.fromkeys(row["stream"] for row in state["streams"] if row.get("lost")))
        yield f"{counted(lost, 'event')} {_was(lost)} lost, and not judged{places and ': '}{places}"
    if refused := counters.get("refused"):
        yield f"{counted(refused, 'event')} {_was(refused)} refused, unreadable or of no stream here, and not judged"
    if skipped := counters.get("skipped"):
        yield f"{counted(skipped, 'event')} {_was(skipped)} skipped, late or while the history failed, and not judged"
    for row in state["properties"]:
        if row.get("unknown"):
            yield f"{row['id']} was unknown at {counted(row['unknown'], 'step')}"
    if not (lost or skipped):
        names = [row["id"] for row in state["properties"] if row.get("degraded") and not row.get("unknown")]
        yield from [_degraded([*dict.fromkeys(names)])] if names else []


def _degraded(names: list[str]) -> str:
    """That what properties say may be wrong for good, where nothing else tells why: `capacity`, or another server."""
    more = " and others" if len(names) > _FEW else ""
    return f"verdicts of {', '.join(names[:_FEW])}{more} are degraded: {WHY_DEGRADED}"


def _doubts_of_recording(state: Document) -> Iterator[str]:
    """The same of a judged recording, as `replay` says it; of an older version's, with what is a mere remark."""
    if conclusion := state["recording"]["conclusion"]:
        yield from (f"{each['property']} was not judged: {each['reason']}" for each in conclusion["unjudged"])
        yield from conclusion.get("doubts", conclusion["notes"])
        yield from conclusion["warnings"]


def _was(count: int) -> str:
    return "was" if count == 1 else "were"
