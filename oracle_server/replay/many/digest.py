"""What a recording is: its files, their size, and a digest of their content."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from oracle_server.core.errors import TraceError
from oracle_server.replay.files.sqlitefile import LOG, log_of

_PIECE = 2**20


class Extent(NamedTuple):
    """The files of a recording, with their sizes and when each was last written (ns)."""

    files: tuple[tuple[Path, int, int], ...]

    @property
    def size(self) -> int:
        """All of their bytes."""
        return sum(size for _, size, _ in self.files)


def extent(recording: Path) -> Extent:
    """The files of a recording as they are now: itself, or those of its folder. Raises `TraceError`.

    Of a database that is the recording itself so is its log, where its recorder was killed.
    """
    try:
        if recording.is_dir():
            paths = sorted(path for path in recording.iterdir() if path.is_file())
        elif recording.is_file() or not recording.exists():
            log = log_of(recording)
            paths = [recording] if log is None else [recording, log]
        else:
            raise TraceError(f"{recording}: is neither a file nor a folder")
        stats = [(path, path.stat()) for path in paths]
    except OSError as error:
        raise TraceError(f"{recording}: can't be read: {error.strerror}") from None
    return Extent(tuple((path, stat.st_size, stat.st_mtime_ns) for path, stat in stats))


def digest(recording: Path, known: Extent) -> str:
    """The SHA-256 of a recording, in hexadecimal; of a folder that of its files' names and contents.

    That of a database with a log is of both, and not of their names.

    Of each file as many bytes are read as it had. Raises `TraceError`.
    """
    whole = hashlib.sha256()
    try:
        for path, size, _ in known.files:
            if path == recording:
                _add(whole, path, size)
            else:
                part = hashlib.sha256()
                _add(part, path, size)
                name = LOG if path.parent == recording.parent else path.name
                whole.update(f"{part.hexdigest()} {name}\n".encode(errors="surrogateescape"))
    except OSError as error:
        raise TraceError(f"{recording}: can't be read: {error.strerror}") from None
    return whole.hexdigest()


def folders_digest(folders: Sequence[Path]) -> str | None:
    """The SHA-256 of the definitions below folders, by their places in these; None without folders."""
    if not folders:
        return None
    whole = hashlib.sha256()
    for folder in folders:
        for path in sorted(path for kind in ("msg", "srv", "action") for path in folder.rglob(f"*.{kind}")):
            place = os.fsencode(path.relative_to(folder))
            whole.update(b"%s %s\n" % (hashlib.sha256(path.read_bytes()).hexdigest().encode(), place))
        whole.update(b"\n")
    return whole.hexdigest()


def _add(whole: hashlib._Hash, path: Path, size: int) -> None:
    with path.open("rb") as file:
        while size > 0 and (piece := file.read(min(size, _PIECE))):
            whole.update(piece)
            size -= len(piece)
