"""A watch over connections: what waits for a PostgreSQL that is silent would wait for ever."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable
from typing import Protocol

LOOK_EVERY = 0.5
"""Seconds between two looks for connections that have waited for too long."""


class Watched(Protocol):
    """A connection that may be silent."""

    def sever_if_silent(self) -> None:
        """End it where it has waited for an answer for too long."""


class Watch:
    """A thread that ends silent connections, and a clock by which they are: it stands still while this process does.

    What PostgreSQL has answered meanwhile is still to be read when the process goes on.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Watch nothing yet; `clock` gives seconds."""
        self._clock = clock
        self._stood = 0.0
        self._last: float | None = None
        self._all: weakref.WeakSet[Watched] = weakref.WeakSet()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def now(self) -> float:
        """Seconds for which this process has run, from any time on."""
        return self._clock() - self._stood

    def add(self, connection: Watched) -> None:
        """Watch a connection for as long as anyone has it."""
        with self._lock:
            self._all.add(connection)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="history watch", daemon=True)
                self._thread.start()

    def look(self) -> None:
        """End those that are silent. The last look was `LOOK_EVERY` ago, unless the process stood still since."""
        now = self._clock()
        if self._last is not None:
            self._stood += max(0.0, now - self._last - 2 * LOOK_EVERY)
        self._last = now
        with self._lock:
            all_of_them = [*self._all]
        for connection in all_of_them:
            connection.sever_if_silent()

    def _run(self) -> None:
        while True:
            time.sleep(LOOK_EVERY)
            self.look()
