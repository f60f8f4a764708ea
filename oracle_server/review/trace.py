"""A session's trace from its history: a line an event or tick, in order of arrival, with its places as it was judged.

The history keeps what formulas saw of a message, and not the message: a line has `signals` in place of `data`, and what
oracles elsewhere said of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from oracle_server.history.sqlite.schema import OUTCOMES, STEP_COLUMNS
from oracle_server.history.sqlite.store import Store
from oracle_server.specfiles.load import parse_spec

_COLUMNS = (
    "stream", "kind", "monitor", "seq", "stamp", "arrived", "source", "call", "lost",
)  # fmt: skip


def trace_lines(store: Store, session: int) -> Iterator[dict[str, Any]]:
    """The lines of what a session has judged and committed; memory does not grow with their number."""
    select = f"SELECT {','.join(STEP_COLUMNS)} FROM steps WHERE session = ? "  # noqa: S608
    external = _external(store, session)
    line: dict[str, Any] | None = None
    for row in store.each(select + "ORDER BY arrived, monitor, seq, position", (session,)):
        r = dict(zip(STEP_COLUMNS, row, strict=True))
        same = line is not None and (line["monitor"], line["seq"]) == (r["monitor"], r["seq"])
        if line is None or not same or r["kind"] == "tick":
            if line is not None:
                yield line
            line = _line(r)
        line["places"].append(_place(r) | ({"said": _said(r, external)} if external else {}))
        if r["ord"] == "publication":
            line |= {"passed": _truth(r["passed"]), "why": r["why"]}
    if line is not None:
        yield line


def _line(row: dict[str, Any]) -> dict[str, Any]:
    line = {name: row[name] for name in _COLUMNS}
    signals, failed = msgspec.json.decode(row["signals"]), msgspec.json.decode(row["failed"])
    more = {
        "ask": bool(row["ask"]),
        "passed": _truth(row["passed"]),
        "why": row["why"],
        "signals": signals,
        "failed": failed,
        "places": [],
    }
    return line | more


def _place(row: dict[str, Any]) -> dict[str, Any]:
    return {
        "position": row["position"],
        "order": row["ord"],
        "judged": row["judged"],
        "late": bool(row["late"]),
        "skewed": bool(row["skewed"]),
        "forced": bool(row["forced"]),
        "skipped": row["number"] is None,
        "degraded": "0" not in row["degraded"],
    }


def _external(store: Store, session: int) -> dict[int, str]:
    """The properties of a session that oracles elsewhere judge, by their places; none while it is not committed."""
    rows = store.read("SELECT text FROM sessions WHERE number = ?", (session,))
    if not rows or "external" not in rows[0][0]:
        return {}
    properties = parse_spec(rows[0][0], "").spec.properties
    return {i: p.id for i, p in enumerate(properties) if p.external is not None}


def _said(row: dict[str, Any], external: dict[int, str]) -> dict[str, tuple[str, str, bool]]:
    """What oracles elsewhere said of a step, and whether something before it was not known to them."""
    why = msgspec.json.decode(row["explanations"]) if row["explanations"] else {}
    return {
        name: (
            OUTCOMES[row["outcomes"][i]].value,
            why[str(i)]["reasons"][0]["text"] if why.get(str(i), {}).get("reasons") else "said so",
            row["degraded"][i] == "1",
        )
        for i, name in external.items()
    }


def _truth(value: int | None) -> bool | None:
    return None if value is None else bool(value)
