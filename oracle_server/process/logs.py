"""Where the server's log goes: standard error or a file with rotation, for people or as JSON."""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
from pathlib import Path
from typing import TextIO

import structlog

from oracle_server.core.errors import OracleError
from oracle_server.process.settings import Settings

MAX_SIZE = 10 * 2**20
"""Bytes of a log file before the next one is begun."""
KEPT = 4
"""Older log files that are kept: `server.log.1` is the latest of them."""


class LogError(OracleError):
    """A log file that can't be written."""


class RotatingFile:
    """A text file that is put aside when it is full. A disk that is full costs lines, and nothing else."""

    def __init__(self, path: Path, max_size: int = MAX_SIZE, kept: int = KEPT) -> None:
        """Append to a file. Raises `LogError` where it can't be opened."""
        self._path, self._max_size, self._kept = path, max_size, kept
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._file = self._open()
        except OSError as error:
            raise LogError(f"{path}: can't be written as log: {error.strerror}") from None

    def write(self, text: str) -> None:
        """Append text, to a new file where the old one would grow too long."""
        with self._lock, contextlib.suppress(OSError):
            if self._file.tell() and self._file.tell() + len(text) > self._max_size:
                self._rotate()
            self._file.write(text)
            self._file.flush()

    def flush(self) -> None:
        """All is flushed as it is written."""

    def close(self) -> None:
        """Write no more."""
        self._file.close()

    def _rotate(self) -> None:
        self._file.close()
        for age in range(self._kept, 0, -1):
            older = self._path if age == 1 else self._aside(age - 1)
            if older.exists():
                older.replace(self._aside(age))
        self._file = self._open()

    def _aside(self, age: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{age}")

    def _open(self) -> TextIO:
        return self._path.open("a", encoding="utf-8", errors="backslashreplace")


def set_up_logs(settings: Settings) -> None:
    """Send all that is logged where the settings say. Raises `LogError` where that can't be."""
    out = RotatingFile(settings.log_file) if settings.log_file else sys.stderr
    renderer = (
        structlog.processors.JSONRenderer()
        if settings.log == "json"
        else structlog.dev.ConsoleRenderer(colors=settings.log_file is None and sys.stderr.isatty())
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.WriteLoggerFactory(out),  # type: ignore[arg-type]
    )
    handler = logging.StreamHandler(out)
    logging.basicConfig(handlers=[handler], level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    logging.getLogger("uvicorn.error").addFilter(_without_traceback)


def _without_traceback(record: logging.LogRecord) -> bool:
    """A client's malformed text is no bug of ours: one line says so."""
    if record.getMessage().startswith("Invalid UTF-8"):
        record.exc_info = None
    return True
