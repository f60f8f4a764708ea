"""What a session is called."""

from __future__ import annotations

from typing import NamedTuple


class Identity(NamedTuple):
    """A session's name, its number in the history, whether it ends with its last monitor, and since when it is (ns)."""

    id: str
    number: int
    private: bool
    opened: int
