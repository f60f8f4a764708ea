"""Log lines that others cause, at most one a second for each cause."""

from __future__ import annotations

import logging
import time

EVERY = 1.0
"""Seconds between two lines of one cause."""
_CAUSES = 1_000
"""Causes that are told apart; beyond them all are forgotten, and begin anew."""


class Seldom:
    """Counts how often each cause came, and says when it may be logged again."""

    def __init__(self) -> None:
        self._causes: dict[object, tuple[float, int]] = {}

    def due(self, cause: object) -> int:
        """Count a cause; returns how often it came since its last line, 0 where it must not be logged yet."""
        now = time.monotonic()
        if len(self._causes) > _CAUSES:
            self._causes.clear()
        since, count = self._causes.get(cause, (now - EVERY, 0))
        if now - since < EVERY:
            self._causes[cause] = since, count + 1
            return 0
        self._causes[cause] = now, 0
        return count + 1


class SeldomFilter(logging.Filter):
    """Lets one record a second through for each text of a library's, with the number of those that it stands for."""

    def __init__(self) -> None:
        super().__init__()
        self._seldom = Seldom()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether to log a record."""
        count = self._seldom.due((record.name, record.msg))
        if count > 1:
            record.msg, record.args = f"{record.getMessage()} ({count} times)", ()
        return count > 0
