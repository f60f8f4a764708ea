"""The pid file of a data directory: locked as long as its server runs, so that a stale one is recognised."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path
from typing import IO, NamedTuple

import structlog

from oracle_server.core.errors import OracleError

log = structlog.get_logger()

NAME = "server.pid"
_WITHIN = 1.0
"""Seconds to wait for processes that lock the file only to check it, and for a server to write its pid."""
_POLL_INTERVAL = 0.01
_EMBEDDED = "embedded"


class PidFileError(OracleError):
    """A data directory that can't be used, or is in use."""


class Running(NamedTuple):
    """A server that runs; `url` is None until it accepts work. `embedded`: it is an adapter that judges by itself."""

    pid: int
    url: str | None
    embedded: bool = False


class PidFile:
    """Holds a data directory for this process."""

    def __init__(self, folder: Path, *, embedded: bool = False, wait: float = 0.0) -> None:
        """Make the folder and lock it; `embedded`: for an adapter that judges by itself.

        Another such adapter that has it may be ending: it is waited for, for `wait` seconds at most.

        Raises `PidFileError` where another server has it, or it can't be used.
        """
        self._embedded = embedded
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            _demand_no_pipe(folder / NAME)
            self._file = open(folder / NAME, "a+", encoding="utf-8", opener=_private)  # noqa: SIM115 -- held
        except OSError as error:
            raise PidFileError(f"{folder}: can't be used as data directory: {error.strerror}") from None
        if not (self._locked(_WITHIN) or (wait > 0 and self._is_embedded() and self._locked(wait))):
            self._file.close()
            raise PidFileError(
                f"{folder}: another server, or an adapter with --embedded, uses this data directory; stop it, "
                "choose another one, or read it beside that by `oracle-server serve --read-only`"
            )
        self.publish(None)

    def _is_embedded(self) -> bool:
        """Whether an adapter has the file; it is told of then, as it may take a while to end."""
        self._file.seek(0)
        found = self._file.read().endswith(f"\n{_EMBEDDED}")
        if found:
            log.warning("another adapter with --embedded uses the data directory: waiting for its end")
        return found

    def _locked(self, within: float) -> bool:
        """Lock the file; False where a server has locked it. A process that checks for one locks it for a moment."""
        deadline = time.monotonic() + within
        while True:
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() > deadline:
                    return False
                time.sleep(_POLL_INTERVAL)
            else:
                return True

    def publish(self, url: str | None) -> None:
        """Write the pid, and the URL at which the server accepts work. Raises `PidFileError` where that fails."""
        try:
            self._file.seek(0)
            self._file.truncate()
            self._file.write(f"{os.getpid()}\n{url or ''}\n{_EMBEDDED if self._embedded else ''}")
            self._file.flush()
        except OSError as error:
            raise PidFileError(f"{self._file.name}: can't be written: {error.strerror}") from None

    def release(self) -> None:
        """Unlock the data directory; the file stays, and is ignored without its lock."""
        self._file.close()


def _demand_no_pipe(path: Path) -> None:
    """Raise `PidFileError` for a pipe: to open it would wait for who writes to it, without an end."""
    if path.is_fifo():
        raise PidFileError(f"{path}: is a pipe, and no file: delete it, or name another --data-dir")


def _private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def running(folder: Path) -> Running | None:
    """The server that holds a data directory, None where none does. Raises `PidFileError` where that can't be read."""
    deadline = time.monotonic() + _WITHIN
    try:
        _demand_no_pipe(folder / NAME)
        with (folder / NAME).open(encoding="utf-8") as file:
            while _is_locked(file):
                file.seek(0)
                pid, *more = file.read().split("\n")
                if len(more) > 1:
                    return Running(int(pid), more[0] or None, more[1] == _EMBEDDED)
                if time.monotonic() > deadline:
                    raise PidFileError(f"{folder / NAME}: does not name the server that uses this data directory")
                time.sleep(_POLL_INTERVAL)  # it is being written
    except FileNotFoundError:
        return None
    except OSError as error:
        raise PidFileError(f"{folder / NAME}: can't be read: {error.strerror}; --data-dir names a folder") from None
    except ValueError as error:
        raise PidFileError(f"{folder / NAME}: can't be read: {error}") from None
    return None


def is_held_by(folder: Path, pid: int) -> bool:
    """Whether the process that has a number here may be the server of a data directory: it has its pid file open.

    A server in a container has numbers of its own, which name other processes elsewhere.
    """
    try:
        mine = (folder / NAME).stat()
        return any(_is_same(each, mine) for each in Path(f"/proc/{pid}/fd").iterdir())
    except PermissionError:  # another user's, or one that nobody may look at
        return True
    except FileNotFoundError:
        return False


def _is_same(path: Path, file: os.stat_result) -> bool:
    try:
        return os.path.samestat(path.stat(), file)
    except FileNotFoundError:  # it was closed meanwhile
        return False


def _is_locked(file: IO[str]) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    fcntl.flock(file, fcntl.LOCK_UN)
    return False
