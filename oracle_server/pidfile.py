"""The pid file of a data directory: locked for as long as its server lives, so that a stale one deceives nobody."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import NamedTuple

from oracle_server.core.errors import OracleError

NAME = "server.pid"


class PidFileError(OracleError):
    """A data directory that can't be used, or is in use."""


class Running(NamedTuple):
    """A server that runs; `url` is None until it accepts work."""

    pid: int
    url: str | None


class PidFile:
    """Holds a data directory for this process."""

    def __init__(self, folder: Path) -> None:
        """Make the folder and lock it. Raises `PidFileError` where another server has it, or it can't be used."""
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._file = (folder / NAME).open("a+")
        except OSError as error:
            raise PidFileError(f"{folder}: can't be used as data directory: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.close()
            raise PidFileError(
                f"{folder}: another server uses this data directory; stop it, or choose another one"
            ) from None
        self.tell(None)

    def tell(self, url: str | None) -> None:
        """Note where this process accepts work. Raises `PidFileError` where the file can not be written."""
        try:
            self._file.seek(0)
            self._file.truncate()
            self._file.write(f"{os.getpid()}\n{url or ''}\n")
            self._file.flush()
        except OSError as error:
            raise PidFileError(f"{self._file.name}: can't be written: {error.strerror}") from None

    def release(self) -> None:
        """Let go of the folder; the file stays, and says nothing without its lock."""
        self._file.close()


def running(folder: Path) -> Running | None:
    """The server that holds a data directory, None where none does. Raises `PidFileError` where that can't be read."""
    try:
        with (folder / NAME).open() as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                pid, url, *_ = [*file.read().split("\n"), "", ""]
                return Running(int(pid or 0), url or None)
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise PidFileError(f"{folder / NAME}: can't be read: {error}") from None
    return None
