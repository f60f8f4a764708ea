"""Folders for what is unpacked while a recording is judged, of which nothing is to be left."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory


@contextmanager
def unpacking() -> Iterator[Path]:
    """A folder for what is unpacked, which is deleted in the end. Raises OSError."""
    with TemporaryDirectory(prefix="oracle-server-", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def let_go(folder: Path) -> None:
    """Delete a folder whose files are open: what they have is there until they are closed, however the process ends.

    Where the system does not delete what is open they are deleted in the end.
    """
    shutil.rmtree(folder, ignore_errors=True)
