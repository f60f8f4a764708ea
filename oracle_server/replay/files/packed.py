"""The folder of a bag as one file, as `tar` packs it: how it is sent where there is room for one file alone."""

from __future__ import annotations

import tarfile
from pathlib import Path, PurePosixPath

from oracle_server.core.errors import TraceError
from oracle_server.replay.files.scratch import write

HEAD = 512
"""Bytes by which a packed folder is known."""
_MARK, _AT = b"ustar", 257
_MOST = 1_000
"""Files of a bag."""
_PLAIN = (tarfile.REGTYPE, tarfile.AREGTYPE)


def is_packed(head: bytes) -> bool:
    """Whether a file that begins so is a folder that was packed by tar."""
    return head.startswith(_MARK, _AT)


def unpack(path: Path, folder: Path) -> None:
    """Write the files that were packed into a folder, by their names alone. Raises `TraceError` and OSError."""
    count = 0
    try:
        with tarfile.open(path, "r:") as packed:
            for member in packed:
                name = PurePosixPath(member.name).name
                if member.size < 0:  # the next one would be looked for before it, for ever
                    raise TraceError(f"{path}: can't be unpacked: a file of it has a size below 0")
                if member.type not in _PLAIN or member.issparse() or name[:1] in ("", "."):
                    continue
                count += 1
                if count > _MOST:
                    raise TraceError(f"{path}: has more than {_MOST} files, which no bag has")
                _write(packed, member, path, folder / name)
    except RecursionError:
        raise TraceError(f"{path}: can't be unpacked: too many headers stand before a file") from None
    except (tarfile.TarError, EOFError, ValueError, OverflowError) as error:
        raise TraceError(f"{path}: can't be unpacked: {error}") from None
    if not count:
        raise TraceError(f"{path}: has no files")


def _write(packed: tarfile.TarFile, member: tarfile.TarInfo, path: Path, to: Path) -> None:
    source = packed.extractfile(member)
    if source is None:
        return
    try:
        write(source, to, path)
    except FileExistsError:
        raise TraceError(f"{path}: has two files of the name {to.name}; pack one bag alone") from None
    if to.stat().st_size < member.size:
        raise TraceError(f"{path}: ends within {to.name}")
