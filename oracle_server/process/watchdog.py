"""A watchdog for the event loop: a thread that reports when the loop is blocked, and at which line."""

from __future__ import annotations

import asyncio
import sys
import threading
import time
import traceback
from typing import Self

import structlog

from oracle_server.process.notify import notify, watchdog_interval

STALLED = 2.0
"""Seconds for which the loop may be blocked before that is reported."""

log = structlog.get_logger()


class Watchdog:
    """A context manager that watches the event loop in which it is entered, and sends `WATCHDOG=1` to systemd."""

    def __init__(self, stalled: float = STALLED) -> None:
        """Report when the loop is blocked for `stalled` seconds."""
        self.stalls = 0
        """How often the loop was blocked so long."""
        self._stalled, self._every = stalled, stalled / 4
        self._last = time.monotonic()
        self._notified = self._last
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._beating: asyncio.TimerHandle | None = None
        self._interval = watchdog_interval()

    def __enter__(self) -> Self:
        """Begin to watch."""
        self._loop = asyncio.get_running_loop()
        self._watched = threading.get_ident()
        self._beat()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop watching."""
        self._over.set()
        if self._beating:
            self._beating.cancel()
        self._thread.join()

    def _beat(self) -> None:
        self._last = time.monotonic()
        if self._interval is not None and self._last - self._notified >= self._interval:
            self._notified = self._last
            notify("WATCHDOG=1")
        self._beating = self._loop.call_later(min(self._every, self._interval or self._every), self._beat)

    def _watch(self) -> None:
        checked, reported = time.monotonic(), 0.0
        while not self._over.wait(self._every):
            now = time.monotonic()
            slept, checked = now - checked, now
            if slept > self._stalled:  # the whole process was stopped, not the loop alone
                continue
            if now - self._last > self._stalled and self._last != reported:
                place, reported = self._place(), self._last
                self.stalls += 1
                log.warning("the event loop stands still", seconds=round(now - reported, 1), at=place)

    def _place(self) -> str:
        frame = sys._current_frames().get(self._watched)  # noqa: SLF001 -- the documented way to another thread's stack
        if frame is None:
            return "unknown"
        inner = traceback.extract_stack(frame)[-1]
        return f"{inner.filename}:{inner.lineno} {inner.name}"
