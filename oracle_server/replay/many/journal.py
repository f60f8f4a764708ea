"""Results as they come, in a file beside the table: whoever is ended loses none of them, and the next run goes on."""

from __future__ import annotations

import errno
import fcntl
import os
import time
from collections.abc import Iterator
from io import FileIO
from pathlib import Path

import msgspec

from oracle_server.replay.many.row import Row
from oracle_server.replay.many.tablefile import ResultsError

_SYNC_EVERY = 1.0
"""Seconds of results that a machine which loses its power may lose; a process that ends loses none."""
_DECODER = msgspec.json.Decoder(tuple[Row, ...])


class Journal:
    """Units of rows, a line each, by where their lines begin. One process at a time has it open."""

    def __init__(self, path: Path) -> None:
        """Open it, or make it. Raises `ResultsError`."""
        self.path = path
        try:
            self._file = _locked(path)
            self._reader = path.open("rb")
        except OSError as error:
            raise ResultsError(f"{path}: can't be written: {error.strerror}") from None
        self._end = 0
        self._synced = time.monotonic()

    def close(self) -> None:
        """Let go of it, with what is in it."""
        self._reader.close()
        self._file.close()

    def lines(self) -> Iterator[tuple[int, tuple[Row, ...]]]:
        """Where each unit stands that is there, and its rows; what was not written to its end is dropped.

        To be read to its end before anything is added. Raises `ResultsError`.
        """
        self._end = 0
        self._reader.seek(0)
        for line in self._reader:
            if not line.endswith(b"\n"):
                break
            try:
                rows = _DECODER.decode(line)
            except msgspec.DecodeError:
                if self._end == 0:
                    raise ResultsError(f"{self.path}: is there, and is no journal of results: remove it") from None
                break  # the machine had no power to write it
            yield self._end, rows
            self._end += len(line)
        self._file.truncate(self._end)

    def add(self, rows: tuple[Row, ...]) -> int:
        """Write a unit, and return where it stands. Raises `ResultsError`."""
        line, at = msgspec.json.encode(rows) + b"\n", self._end
        try:
            written = self._file.write(line)
            if time.monotonic() >= self._synced + _SYNC_EVERY:
                self.sync()
        except OSError as error:
            raise ResultsError(f"{self.path}: can't be written: {error.strerror}") from None
        if written != len(line):
            raise ResultsError(f"{self.path}: can't be written: {os.strerror(errno.ENOSPC)}")
        self._end += len(line)
        return at

    def sync(self) -> None:
        """Have all that was written on the disk."""
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()

    def read(self, at: int) -> tuple[Row, ...]:
        """The unit that stands somewhere."""
        self._reader.seek(at)
        return _DECODER.decode(self._reader.readline())

    def remove(self) -> None:
        """Remove the file."""
        self.path.unlink(missing_ok=True)


def _locked(path: Path) -> FileIO:
    while True:
        file = FileIO(path, "ab")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise ResultsError(f"{path}: another `replay` writes these results: wait for it") from None
        if path.exists() and os.path.samestat(os.fstat(file.fileno()), path.stat()):
            return file
        file.close()  # who had it has just ended, and removed it
