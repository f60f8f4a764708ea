"""The server's log: to standard error or a file with rotation, as text or JSON."""

from __future__ import annotations

import asyncio
import atexit
import logging
import os
import sys
from collections.abc import Callable
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Final, Literal

import structlog
from structlog.stdlib import ProcessorFormatter
from structlog.types import EventDict, Processor

from oracle_server.core.errors import HistoryError, OracleError, one_line
from oracle_server.process.loglines import LogLines, by_handler, to_standard_error
from oracle_server.process.seldom import SeldomFilter
from oracle_server.process.settings import Settings
from oracle_server.process.shortage import shortage

MAX_SIZE = 10 * 2**20
"""Bytes of a log file before it is rotated."""
KEPT = 4
"""Rotated log files that are kept; `server.log.1` is the newest of them."""


_FIRST: Final[list[Processor]] = [
    structlog.processors.add_log_level,
    structlog.processors.TimeStamper(fmt="iso", utc=True),
]
_LIBRARIES = ("asyncio", "uvicorn.error", "websockets.server")
"""Loggers whose lines anybody who connects can cause."""
_REFUSED = "ASGI callable returned without completing handshake."
"""What uvicorn says of every WebSocket that was answered by an error."""


class LogError(OracleError):
    """A log file that can't be written."""


def set_up_logs(settings: Settings) -> Callable[[], None]:
    """Configure logging by the settings. Raises `LogError` where the log file can't be written.

    What is returned writes the lines that still wait, as the end of the process does.
    """
    handler = LogLines(by_handler(_file(settings.log_file)) if settings.log_file else to_standard_error)
    atexit.register(handler.end)
    handler.setFormatter(_formatter(settings.log, colors=settings.log_file is None and sys.stderr.isatty()))
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    logging.raiseExceptions = False  # on a full disk, lines are lost without further errors
    logging.getLogger("uvicorn.error").addFilter(_without_traceback)
    for library in _LIBRARIES:
        logging.getLogger(library).addFilter(SeldomFilter())
    _log_by(logging.getLogger("oracle_server"), logging.INFO)
    return handler.end


def set_up_warnings() -> None:
    """Log warnings and errors alone, to standard error, in a program whose own log is left as it is.

    Where that can't be written, as on a full disk, lines are lost, and nothing else is.
    """
    handler = LogLines(to_standard_error)
    atexit.register(handler.end)
    handler.setFormatter(_formatter("console", colors=sys.stderr.isatty()))
    own = logging.getLogger("oracle_server")
    own.handlers, own.propagate = [handler], False
    _log_by(own, logging.WARNING)


def _log_by(logger: logging.Logger, level: int) -> None:
    logger.setLevel(level)
    structlog.configure(
        processors=[*_FIRST, ProcessorFormatter.wrap_for_formatter],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=lambda *_: logger,
    )


def _formatter(form: Literal["console", "json"], *, colors: bool) -> ProcessorFormatter:
    renderer = (
        structlog.processors.JSONRenderer()
        if form == "json"
        else structlog.dev.ConsoleRenderer(colors=colors, exception_formatter=structlog.dev.plain_traceback)
    )
    last: list[Processor] = [
        ProcessorFormatter.remove_processors_meta,
        structlog.processors.format_exc_info,
        *((_escaped,) if form == "console" else ()),
        renderer,
    ]
    return ProcessorFormatter(processors=last, foreign_pre_chain=_FIRST)


def _file(path: Path) -> RotatingFileHandler:
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        if path.is_fifo():  # to open one that nobody reads would wait for who does
            os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
        return RotatingFileHandler(
            path, maxBytes=MAX_SIZE, backupCount=KEPT, encoding="utf-8", errors="backslashreplace"
        )
    except OSError as error:
        reason = "it is a pipe that nobody reads" if path.is_fifo() else error.strerror
        raise LogError(f"{path}: can't be written as log: {reason}") from None


def _without_traceback(record: logging.LogRecord) -> bool:
    """Log as it is what is no error of the server: malformed text, an answer cut off, a shortage, a refusal."""
    if record.getMessage().startswith("Invalid UTF-8"):
        record.exc_info = None
    elif record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError):
        record.exc_info = None
        record.msg, record.args = "a request did not end in time, and was cut off", ()
    elif record.exc_info and isinstance(reason := getattr(record.exc_info[1], "__cause__", None), HistoryError):
        record.exc_info = None  # its status had been sent already
        record.msg, record.args = "an answer was cut off: the history can't be read: %s", (reason,)
    elif record.exc_info and isinstance(error := record.exc_info[1], Exception) and (short := shortage(error)):
        record.exc_info = None
        record.msg, record.args = "a request could not be answered: %s", (short,)
    elif record.getMessage() == _REFUSED:
        record.levelno, record.levelname = logging.WARNING, "WARNING"
        record.msg, record.args = "a WebSocket was refused; the answer told its client why", ()
    return True


def _escaped(_: object, __: str, event: EventDict) -> EventDict:
    """A line whose values can't begin another one or command a terminal, whoever they come from.

    A traceback keeps its lines, each of them indented.
    """
    return {
        key: "\n".join(f"  {one_line(line)}" for line in str(value).split("\n"))
        if key == "exception"
        else one_line(value if isinstance(value, str) else repr(value))
        for key, value in event.items()
    }
