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


@contextmanager
def read_only(folder: Path) -> Iterator[Path]:
    """A folder seen through a mount beside it that is read-only. Raises `Unmountable`."""
    seen = folder.with_name(f"{folder.name}-read-only")
    seen.mkdir()
    commands = (["mount", "--bind", str(folder), str(seen)], ["mount", "-o", "remount,ro,bind", str(seen)])
    if any(subprocess.run(command, capture_output=True, check=False).returncode for command in commands):
        subprocess.run(["umount", seen], capture_output=True, check=False)
        raise Unmountable("a folder can't be mounted read-only here")
    try:
        yield seen
    finally:
        subprocess.run(["umount", seen], check=True)
