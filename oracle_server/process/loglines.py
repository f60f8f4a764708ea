"""A log that is written by a thread of its own: who stops reading it, or a disk that stands still, stops nothing."""

from __future__ import annotations

import logging
import os
import threading
from queue import SimpleQueue

MOST = 10_000
"""Lines that may wait to be written; beyond them, lines are lost, and their number is told."""
_AT_END = 2.0
"""Seconds in which waiting lines are still written when the process ends."""
_LOST = "%d lines of the log were lost: it was not written in time"
_STDERR = 2


class LogLines(logging.Handler):
    """Formats records where they are logged, and hands the lines to a thread that writes them with a handler."""

    def __init__(self, written: logging.Handler) -> None:
        """Write with a handler, which nobody else uses."""
        super().__init__()
        self._written = written
        written.lock = None  # a thread that stands still would hold it at the end of the process, which waits for it
        self._waiting: SimpleQueue[str | None] = SimpleQueue()
        self._lost = 0
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a record's line, unless too many wait."""
        if self._waiting.qsize() >= MOST:
            self._lost += 1
            return
        try:
            self._waiting.put(self.format(record))
        except Exception:  # noqa: BLE001 -- as any handler does
            self.handleError(record)

    def end(self) -> None:
        """Write what waits, for `_AT_END` seconds at most; what is logged later is lost."""
        self._waiting.put(None)
        self._thread.join(_AT_END)

    def _run(self) -> None:
        while (line := self._waiting.get()) is not None:
            self._write(line)
            if self._waiting.empty():
                self._tell_lost()
        self._tell_lost()

    def _tell_lost(self) -> None:
        lost, self._lost = self._lost, 0
        if lost:
            told = {"name": __name__, "levelno": logging.WARNING, "levelname": "WARNING", "msg": _LOST, "args": (lost,)}
            self._write(self.format(logging.makeLogRecord(told)))

    def _write(self, line: str) -> None:
        self._written.handle(logging.makeLogRecord({"msg": line}))


class StandardError:
    """The process's standard error as a stream for a handler; Python's own is locked while a write stands still."""

    def write(self, text: str) -> None:
        """Write it all. Raises `OSError` where it can't be written."""
        data = text.encode(errors="backslashreplace")
        while data:
            data = data[os.write(_STDERR, data) :]

    def flush(self) -> None:
        """Nothing waits."""
