"""Episodes of a running server as a JSON document, or as a table with their explanations."""

from __future__ import annotations

import sys
import time
from typing import Any

from oracle_server.cli.client import Client, of_session
from oracle_server.cli.kept import not_kept
from oracle_server.cli.tables import show
from oracle_server.core.errors import one_line
from oracle_server.core.naming import moment

_HEAD = ("property", "began", "lasted", "violations", "worst", "first", "last")


def show_episodes(
    client: Client,
    session: str | None,
    properties: list[str],
    origin: str | None = None,
    *,
    only_open: bool,
    as_json: bool,
) -> None:
    """Print the episodes of a session, or of all sessions, or of all that are forwarded from a robot."""
    path = "episodes" if session is None else of_session(session, "episodes")
    items = client.pages(path, property=properties, open=True if only_open else None, origin=origin)
    head = _HEAD if session is not None else ("session", *_HEAD)
    rows = [(item["session"], *_row(item))[-len(head) :] for item in items]
    show({"items": items}, head, rows, as_json=as_json)
    if session is not None and not (as_json or only_open):
        sys.stdout.write(not_kept(client, session, client.get(of_session(session)), properties))
    if items and not as_json:
        sys.stdout.write(
            "\n" + "".join(f"{one_line(item['explanation'] or '')} (#{item['first']})\n" for item in items)
        )


def _row(item: dict[str, Any]) -> tuple[str, ...]:
    last = "-" if item["last"] is None else str(item["last"])
    began = moment(item["began"], time.time_ns())
    return item["property"], began, _lasted(item), str(item["count"]), _worst(item["worst"]), str(item["first"]), last


def _lasted(item: dict[str, Any]) -> str:
    """How long, or that it has not ended."""
    if item["open"]:
        return "for good" if item["final"] else "open"
    return f"{(item['until'] - item['began']) / 10**9:.3f} s"


def _worst(worst: dict[str, Any] | None) -> str:
    if not worst:
        return "-"
    if "robustness" in worst:
        return f"robustness {worst['robustness']:g}" if isinstance(worst["robustness"], float) else worst["robustness"]
    return f"{worst['signal']} = {worst['value']:g}, wanted {worst['op']} {worst['bound']:g}"
