"""A watchdog for the event loop: it reports when the loop is blocked, and at which line.

A thread sees a loop that waits. It sees none that holds the interpreter, in one long call of a library, since then no
other thread runs: a timer of the operating system notes the place as soon as that call lets Python go on.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import threading
import time
from types import FrameType
from typing import Any, Self

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
        self._reported: float | None = None  # the last sign of life before the stall that was reported last
        self._at: str | None = None  # where the loop was when the timer expired
        self._reporting = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._beating: asyncio.TimerHandle | None = None
        self._interval = watchdog_interval()
        self._timed = False
        self._before: Any = None

    def __enter__(self) -> Self:
        """Begin to watch."""
        self._loop = asyncio.get_running_loop()
        self._watched = threading.get_ident()
        if threading.current_thread() is threading.main_thread():  # Python runs handlers of signals there alone
            self._before, self._timed = signal.signal(signal.SIGALRM, self._expired), True
        self._last = time.monotonic()
        self._beat()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop watching."""
        self._over.set()
        if self._beating:
            self._beating.cancel()
        self._thread.join()
        if self._timed:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, self._before)

    def _beat(self) -> None:
        now = time.monotonic()
        before, self._last = self._last, now
        if now - before > self._stalled:
            self._report(before, now, "the event loop stood still")
        self._at = None
        if self._timed:
            signal.setitimer(signal.ITIMER_REAL, self._stalled)
        if self._interval is not None and self._last - self._notified >= self._interval:
            self._notified = self._last
            notify("WATCHDOG=1")
        self._beating = self._loop.call_later(min(self._every, self._interval or self._every), self._beat)

    def _watch(self) -> None:
        while not self._over.wait(self._every):
            last, now = self._last, time.monotonic()
            if now - last > self._stalled:
                self._report(last, now, "the event loop stands still")

    def _report(self, last: float, now: float, what: str) -> None:
        """Log a stall that has begun after `last`, unless it is logged already."""
        with self._reporting:
            if self._reported == last:
                return
            self._reported = last
            self.stalls += 1
        log.warning(what, seconds=round(now - last, 1), at=self._at or self._place())

    def _expired(self, _: int, frame: FrameType | None) -> None:
        """Note where the loop is; it runs between two steps of whatever the loop runs, so that it must not log."""
        self._at = "unknown" if frame is None else _where(frame)

    def _place(self) -> str:
        frame = sys._current_frames().get(self._watched)  # noqa: SLF001 -- the documented way to another thread's stack
        while frame is not None and frame.f_code.co_filename == __file__:  # it is noting the place itself
            frame = frame.f_back
        return "unknown" if frame is None or threading.get_ident() == self._watched else _where(frame)


def _where(frame: FrameType) -> str:
    return f"{frame.f_code.co_filename}:{frame.f_lineno} {frame.f_code.co_name}"
