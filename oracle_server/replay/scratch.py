"""Folders for what is unpacked while a recording is judged, of which nothing is to be left."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
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
    """The disk has no room for what is unpacked."""


class Source(Protocol):
    """What is unpacked."""

    def read(self, size: int, /) -> bytes:
        """The next bytes, none at the end."""
        ...


@contextmanager
def unpacking() -> Iterator[Path]:
    """A folder for what is unpacked, which is deleted in the end. Raises OSError."""
    with TemporaryDirectory(prefix="oracle-server-", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def write(source: Source, to: Path, of: Path) -> None:
    """Write what is unpacked `of` a recording to a new file.

    How much that is nobody knows before, and some kilobytes may become all that the disk has: it is not filled. Raises
    `NoRoomError` then, and OSError.
    """
    written = looked = 0
    with to.open("xb") as out:
        while piece := source.read(_PIECE):
            out.write(piece)
            written += len(piece)
            if written > RESERVE and written >= looked + _LOOK_EVERY:
                looked = written
                if shutil.disk_usage(to.parent).free < RESERVE:
                    free = f"{RESERVE >> 20} MiB of the disk that TMPDIR is on are left free"
                    raise NoRoomError(f"{of}: unpacks to more than there is room for: {written >> 20} MiB, and {free}")


def let_go(folder: Path) -> None:
    """Delete a folder whose files are open: what they have is there until they are closed, however the process ends.

    Where the system does not delete what is open they are deleted in the end.
    """
    shutil.rmtree(folder, ignore_errors=True)
