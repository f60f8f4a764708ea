"""The condition that a session is forwarded from a robot, by its name."""

from __future__ import annotations

from oracle_server.history.origins import forwarded_name


def of_origin(column: str, origin: str) -> tuple[str, tuple[int, str]]:
    """The condition for a column of sessions' names, with its values."""
    end = forwarded_name("", origin)  # LIKE takes `_` for any character, and in SQLite one case for the other
    return f"substr({column}, length({column}) - ? + 1) = ?", (len(end), end)
