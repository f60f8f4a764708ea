"""A log that is written by a thread of its own: who stops reading it, or a disk that stands still, stops nothing."""

from __future__ import annotations

import contextlib
import logging
import os
import select
import threading
from collections.abc import Callable
from queue import SimpleQueue

MOST = 10_000
"""Lines that may wait to be written; beyond them, lines are lost, and their number is told."""
_AT_END = 2.0
"""Seconds in which waiting lines are still written when the process ends."""
_LOST = "%d lines of the log were lost: it was not written in time"
_STDERR = 2


class LogLines(logging.Handler):
    """Formats records where they are logged, and hands the lines to a thread that writes them."""

    def __init__(self, write: Callable[[str], object]) -> None:
        """Write each line by `write`, which raises nothing."""
        super().__init__()
        self._write = write
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
        self.acquire()  # a line that is lost meanwhile is counted, too
        lost, self._lost = self._lost, 0
        self.release()
        if lost:
            told = {"name": __name__, "levelno": logging.WARNING, "levelname": "WARNING", "msg": _LOST, "args": (lost,)}
            self._write(self.format(logging.makeLogRecord(told)))


def by_handler(handler: logging.Handler) -> Callable[[str], object]:
    """Writes lines by a handler, which nobody else uses."""
    return lambda line: handler.handle(logging.makeLogRecord({"msg": line}))


def to_standard_error(line: str) -> None:
    """Write a line; where that can't be, it is lost. Python's own stream would be locked while a write stands still."""
    data = f"{line}\n".encode(errors="backslashreplace")
    with contextlib.suppress(OSError, ValueError):
        while data:
            try:
                data = data[os.write(_STDERR, data) :]
            except BlockingIOError:  # another program that shares it has it so
                select.select([], [_STDERR], [])
