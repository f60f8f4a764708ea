"""Folders for what is unpacked while a recording is judged, of which nothing is to be left."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

from oracle_server.core.errors import OracleError

RESERVE = 256 * 2**20
"""Bytes of the disk that are left free by what unpacks to more than that."""
_PIECE = 2**20
_LOOK_EVERY = 2**24
"""Bytes between two looks at how much of the disk is free."""


class NoRoomError(OracleError):
    """The disk has no room for what is unpacked, or does not take it: nothing is wrong with the recording."""


class Source(Protocol):
    """What is unpacked."""

    def read(self, size: int, /) -> bytes:
        """The next bytes, none at the end."""
        ...


@contextmanager
def unpacking(of: Path) -> Iterator[Path]:
    """A folder for what is unpacked `of` a recording, which is deleted in the end. Raises `NoRoomError`."""
    try:
        folder = TemporaryDirectory(prefix="oracle-server-", ignore_cleanup_errors=True)
    except OSError as error:
        raise _no_room(of, error) from None
    with folder as place:
        yield Path(place)


def write(source: Source, to: Path, of: Path) -> None:
    """Write what is unpacked `of` a recording to a new file.

    How much that is nobody knows before, and some kilobytes may become all that the disk has: it is not filled. Raises
    `NoRoomError` then, and where it can't be written; and OSError.
    """
    written = looked = 0
    with to.open("xb", buffering=0) as out:
        while piece := source.read(_PIECE):
            _put(piece, out, of)
            written += len(piece)
            if written > RESERVE and written >= looked + _LOOK_EVERY:
                looked = written
                if shutil.disk_usage(to.parent).free < RESERVE:
                    free = f"{RESERVE >> 20} MiB of the disk that TMPDIR is on are left free"
                    raise NoRoomError(f"{of}: unpacks to more than there is room for: {written >> 20} MiB, and {free}")


def _put(piece: bytes, out: FileIO, of: Path) -> None:
    left = memoryview(piece)
    try:
        while left:
            left = left[out.write(left) :]
    except OSError as error:
        raise _no_room(of, error) from None


def _no_room(of: Path, error: OSError) -> NoRoomError:
    return NoRoomError(f"{of}: can't be unpacked to the folder for temporary files (TMPDIR): {error.strerror}")


def let_go(folder: Path) -> None:
    """Delete a folder whose files are open: what they have is there until they are closed, however the process ends.

    Where the system does not delete what is open they are deleted in the end.
    """
    shutil.rmtree(folder, ignore_errors=True)
