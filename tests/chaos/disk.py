"""A small disk of its own, that can be filled and freed."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple


class Disk(NamedTuple):
    """A folder on such a disk."""

    folder: Path
    fill: Callable[[], None]
    free: Callable[[], None]


class Unmountable(Exception):  # noqa: N818
    """This user can't mount a disk."""


@contextmanager
def small_disk(folder: Path) -> Iterator[Disk]:
    """One of 24 MiB in memory, mounted at a folder that is made. Raises `Unmountable`."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        raise Unmountable("a small disk can't be mounted here")
    ballast = folder / "ballast"

    def fill() -> None:
        with ballast.open("wb", buffering=0) as file:
            try:
                while True:
                    file.write(bytes(4096))
            except OSError:
                pass

    try:
        yield Disk(folder, fill, ballast.unlink)
    finally:
        subprocess.run(["umount", folder], check=True)
