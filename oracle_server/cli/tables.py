"""The output of commands that read a server or its tokens: a JSON document, or a table."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from oracle_server.cli.client import Client, of_session
from oracle_server.cli.kept import not_kept
from oracle_server.cli.marks import record_marks, violation_text
from oracle_server.cli.reasons import explanation_text
from oracle_server.core.errors import one_line
from oracle_server.core.naming import first_name, moment
from oracle_server.edge.tokens import Token
from oracle_server.process.progress import progress
from oracle_server.process.tables import print_table
from oracle_server.sessions.summary import LISTED, idle, stream_troubles

SESSIONS = ("session", "spec", "status", "monitors", "steps", "violations", "first at")
_CLOSED_WITHIN = 30.0
"""Seconds for a session to be closed: the server answers after ten."""
_EXPLAINED_WITHIN = 600.0
"""Seconds for an explanation, for which all earlier steps are judged again."""


def show_specs(client: Client, *, as_json: bool) -> None:
    """Print all specs."""
    document = client.get("specs")
    rows = [
        (s["id"], str(len(s["streams"])), str(len(s["properties"])), _unsound(s) or s["description"])
        for s in document["items"]
    ]
    show(document, ("spec", "streams", "properties", "description"), rows, as_json=as_json)


def _unsound(spec: Mapping[str, Any]) -> str:
    """Why a spec can't be used, empty where it can."""
    reasons = (spec.get("problem") or "").splitlines()
    more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
    return f"unsound: {reasons[0]}{more}" if reasons else ""


def show_sessions(client: Client, origin: str | None = None, *, as_json: bool) -> None:
    """Print all sessions, or those that are forwarded from a robot."""
    document = client.get("sessions", origin=origin)
    show(document, SESSIONS, [session_row(state) for state in document["items"]], as_json=as_json)
    if not as_json:
        if sum(state["status"] == "closed" for state in document["items"]) >= LISTED:
            sys.stdout.write(f"of closed sessions these are the last {LISTED:,}; `verdicts SESSION` tells of any\n")
        for state in document["items"]:
            _show_caveats(state | {"doubts": _first_of(state.get("doubts", ()))}, f"{state['id']}: ")
            _show_remarks({"remarks": [text] if (text := idle(state)) else []}, f"{state['id']}: ")


def show_closed(client: Client, session: str, *, as_json: bool) -> None:
    """Close a session, and print how it ended."""
    state = client.delete(of_session(session), _CLOSED_WITHIN)
    show({"items": [state]}, SESSIONS, [session_row(state)], as_json=as_json)
    if not as_json:
        _show_caveats(state)
        _show_remarks(state)


def show_verdicts(
    client: Client, session: str, properties: list[str], outcomes: list[str], view: str = "standing", *, as_json: bool
) -> None:
    """Print a session's verdict records in a view, or a summary of its properties and all violations as tables."""
    if as_json or properties or outcomes:
        items = client.pages(of_session(session, "verdicts"), property=properties, outcome=outcomes, **{"as": view})
        _show_records(items, as_json=as_json)
        return
    state = client.get(of_session(session))
    columns = {"property": "id", "outcome": "outcome"} | {name: name for name in _measured(state["properties"])}
    columns |= {"violations": "violations", "first at": "first at", "unknown": "unknown"}
    now = time.time_ns()
    rows = [_row(p | {"first at": first_name(p, now)}, tuple(columns.values())) for p in state["properties"]]
    show(state, tuple(columns), rows, as_json=False)
    _show_caveats(state)
    _show_remarks(state)
    sys.stdout.write(not_kept(client, session, state))
    violations = client.pages(of_session(session, "violations"), **{"as": view})
    if violations:
        sys.stdout.write("\n")
        _show_records(violations, as_json=False)
        sys.stdout.write("\n" + "".join(f"{violation_text(r)} (#{r['n']})\n" for r in violations))


def follow_verdicts(
    client: Client, session: str, properties: list[str], outcomes: list[str], view: str = "standing", *, as_json: bool
) -> None:
    """Print a session's verdict records in a view, one a line, until the session ends."""

    def note(text: str) -> None:
        sys.stderr.write(f"{text}\n")

    wanted = {"property": properties, "outcome": outcomes, "as": view}
    for record in client.events(of_session(session, "stream"), note, **wanted):
        keys = (*_RECORD, *_measured([record]))
        cells = _record_row(record, keys)
        line = json.dumps(record) if as_json else one_line("  ".join(cell for cell in cells if cell))
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


def show_explanation(client: Client, session: str, n: int, view: str = "standing", *, as_json: bool) -> None:
    """Print the explanation of a verdict, as it stands or was said at first."""
    with progress(f"judging again what came before verdict {n}"):
        record = client.get(of_session(session, "verdicts", str(n), "explanation"), _EXPLAINED_WITHIN, **{"as": view})
    if as_json:
        sys.stdout.write(json.dumps(record) + "\n")
    else:
        simulated = bool(record.get("waited")) and client.get(of_session(session))["clock"] == "sim"
        sys.stdout.write(explanation_text(record, simulated=simulated))


def show_tokens(tokens: Sequence[Token], *, as_json: bool) -> None:
    """Print tokens with their scopes, specs and sessions."""
    items = [t.model_dump(mode="json", exclude={"sha256"}) for t in tokens]
    cells = [[", ".join(sorted(item[key])) if item[key] else "all" for key in _BOUND] for item in items]
    rows = [(item["name"], *cell) for item, cell in zip(items, cells, strict=True)]
    show({"items": items}, ("token", *_BOUND), rows, as_json=as_json)


_BOUND = ("scopes", "specs", "sessions")
_RECORD = ("step", "time", "property", "outcome", "stream", "kind", "decision")


def _measured(items: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """The columns of what some properties alone have, if any item has it."""
    return tuple(key for key in ("robustness", "pending") if any(item.get(key) is not None for item in items))


def _show_records(records: Sequence[dict[str, Any]], *, as_json: bool) -> None:
    keys = (*_RECORD, *_measured(records))
    rows = [_record_row(record, keys) for record in records]
    show({"items": records}, (*keys, "", "n"), rows, as_json=as_json)


def _record_row(record: dict[str, Any], keys: Sequence[str]) -> tuple[str, ...]:
    told = record | {"time": moment(record["stamp"], time.time_ns())}
    return (*_row(told, keys), record_marks(record), str(record["n"]))


def _row(item: dict[str, Any], keys: Sequence[str]) -> tuple[str, ...]:
    return tuple(cell(item.get(key)) for key in keys)


def cell(value: object) -> str:
    """A value in a table; `-` where it is not known."""
    if value is None:
        return "-"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _show_caveats(state: dict[str, Any], where: str = "") -> None:
    """Print a session's trouble, why properties are degraded at present, what ails its streams, and its doubts.

    What an older version closed has no such keys.
    """
    sys.stdout.writelines(f"{one_line(where + text)}\n" for text in _caveats(state))


def _show_remarks(state: dict[str, Any], where: str = "") -> None:
    """Print of which properties nothing was asked, which an older server does not tell."""
    sys.stdout.writelines(f"{one_line(where + text)}\n" for text in state.get("remarks", ()))


def _caveats(state: dict[str, Any]) -> list[str]:
    told = [state["trouble"]] if state.get("trouble") else []
    told += [f"{p['id']} is degraded: {text}" for p in state["properties"] for text in p.get("caveats", ())]
    return list(dict.fromkeys([*told, *stream_troubles(state), *state.get("doubts", ())]))


def in_doubt(state: dict[str, Any]) -> str:
    """The first of what `_show_caveats` prints of a session, and how many more there are; empty where all is well."""
    return "".join(_first_of(_caveats(state)))


def _first_of(texts: Sequence[str]) -> list[str]:
    """The first text, and how many more there are, for a list of many sessions."""
    more = f" (and {len(texts) - 1} more)" if len(texts) > 1 else ""
    return [f"{text}{more}" for text in texts[:1]]


def session_row(state: dict[str, Any]) -> tuple[str, ...]:
    """A session's cells under `SESSIONS`."""
    attached = sum(m["connected"] for m in state["monitors"])
    return (
        state["id"],
        state["spec"],
        status_of(state),
        str(attached),
        cell(state["counters"]["steps"]),
        violations_of(state),
        _first(state["properties"]),
    )


def violations_of(state: dict[str, Any]) -> str:
    """How many violations a session has; nothing is known of one that could not be restored."""
    return cell(sum(p["violations"] for p in state["properties"]) if state["properties"] else None)


def status_of(state: dict[str, Any]) -> str:
    """How a session stands, in a word or two; what an older version closed has fewer keys."""
    status = next((word for word in ("live", "idle") if state.get(word)), state["status"])
    return f"{status}, recording" if state.get("kind") == "recording" else status


def _first(properties: Sequence[dict[str, Any]]) -> str:
    """Where the first violation of any property was."""
    violated = [p for p in properties if p["first_violation"] is not None]
    return first_name(min(violated, key=lambda p: int(p["first_violation"]), default={}), time.time_ns())


def show(document: dict[str, Any], head: tuple[str, ...], rows: Sequence[tuple[str, ...]], *, as_json: bool) -> None:
    """Print a document as JSON, or as a table."""
    if as_json:
        sys.stdout.write(json.dumps(document) + "\n")
        return
    print_table(head, rows, sys.stdout)
