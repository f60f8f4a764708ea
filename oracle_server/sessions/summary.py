"""What has changed of a session's state since somebody was told of it."""

from __future__ import annotations

from typing import Any

from oracle_server.history.records import Document

_ROWS = {"properties": ("id", "order"), "streams": ("monitor", "stream", "kind"), "monitors": ("name",)}
"""The lists of a state, and what tells their rows apart."""


def summary(state: Document) -> Document:
    """A session's state without what changes with time alone, and what is long: `lag` of streams, and `hold`."""
    short = {key: value for key, value in state.items() if key != "hold"}
    short["streams"] = [{k: v for k, v in row.items() if k != "lag"} for row in state["streams"]]
    return short


def changed(before: Document, now: Document) -> Document:
    """The keys of a summary that are not as they were before, of lists the rows that are not."""
    return {key: _news(key, before, value) for key, value in now.items() if key not in before or before[key] != value}


def _news(key: str, before: Document, value: Any) -> Any:
    names = _ROWS.get(key)
    if names is None or key not in before:
        return value
    known = {tuple(row[name] for name in names): row for row in before[key]}
    return [row for row in value if known.get(tuple(row[name] for name in names)) != row]
