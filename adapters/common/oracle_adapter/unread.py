"""Messages that could not be read, until an event tells that they are lost, and why."""

from __future__ import annotations

import threading
import time
from typing import Callable

TOLD_WITHIN = 1.0
"""Seconds in which an event of the same stream may tell it; later one of any stream does."""
SHOWN = 10.0
"""Seconds for which it is told that something did not work, as to read a request."""


class Unread:
    """How many messages of a stream nothing has told yet; one thread at a time may call it."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """`clock` returns seconds."""
        self._clock = clock
        self._count, self._since = 0, 0.0

    def __bool__(self) -> bool:
        return self._count > 0

    def add(self, count: int = 1) -> None:
        """Count so many."""
        if not self._count:
            self._since = self._clock()
        self._count += count

    def take(self) -> int:
        """All of them, to be told with an event of the stream."""
        taken, self._count = self._count, 0
        return taken

    def overdue(self) -> int:
        """All of them, for an event of any stream, where none of this one came in time; else 0."""
        return self.take() if self._clock() - self._since >= TOLD_WITHIN else 0


class Recent:
    """Why something does not work that is tried now and then; for any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._why, self._at = "", 0.0

    def add(self, why: str) -> None:
        """It did not work just now."""
        with self._lock:
            self._why, self._at = self._why or why, time.monotonic()

    def look(self) -> str:
        """Why it did not at first; empty once the last time was `SHOWN` seconds ago."""
        with self._lock:
            if self._why and time.monotonic() - self._at >= SHOWN:
                self._why = ""
            return self._why


class Unreadable:
    """What could not be read on one side of a service; for any thread, as calls have their own."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._recent = Recent()
        self.unread = Unread()

    def add(self, why: str) -> None:
        """Count one, and why it could not be."""
        with self._lock:
            self.unread.add()
        self._recent.add(why)

    def take(self) -> int:
        """All that nothing has told yet, to be told with an event of this side."""
        with self._lock:
            return self.unread.take()

    def overdue(self) -> int:
        """The same, for an event of any stream, where none of this side came in time; else 0."""
        with self._lock:
            return self.unread.overdue()

    def look(self) -> str:
        """Why the first one could not be read; empty once the last one was `SHOWN` seconds ago."""
        return self._recent.look()
