"""Files that are no recordings as they are: what each is, by how it begins, and what to do with it."""

from __future__ import annotations

import re
from pathlib import Path

_HEAD = 64
_COMPRESSED = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\x04\x22\x4d\x18": "lz4", b"\xfd7zXZ\0": "xz", b"PK\3\4": "zip"}
"""How files begin that programs other than zstd have made, which compresses those of ROS 2."""
_POINTER = b"version https://git-lfs.github.com/spec/"
"""How what git has in the place of a large file begins."""
_ULOG = b"ULog\x01\x12\x35"
"""How logs of PX4 begin."""
_ADDRESS = re.compile("[a-z][a-z0-9+.-]+:/", re.IGNORECASE)
_OF_PATTERNS = frozenset("*?[")
_NAMED = frozenset({".bag", ".mcap", ".db3", ".zstd"})
"""What the files of bags are called."""
_UNREAD = frozenset({".gz", ".xz", ".bz2", ".lz4", ".zip"})
"""What is behind that where such a file was compressed by a program whose files are not read."""


def is_named(path: Path) -> bool:
    """Whether a file is called as those of bags are."""
    return path.suffix in _NAMED


def is_named_compressed(path: Path, *more: str) -> bool:
    """Whether a file is called as one of a bag, or one of these suffixes, that a program has compressed since."""
    return path.suffix in _UNREAD and (is_named(Path(path.stem)) or Path(path.stem).suffix in more)


def is_pointer(head: bytes) -> bool:
    """Whether a file that begins so only says which one Git LFS has to get."""
    return head.startswith(_POINTER)


def what_it_is(head: bytes) -> str:
    """What a file is that begins so, as the rest of a sentence; empty where that is not known."""
    if not head:
        return "is empty"
    if is_pointer(head):
        return "is a pointer of Git LFS, and not the file that it stands for: get that by `git lfs pull`"
    if head.startswith(_ULOG):
        return "is a log of PX4 (ULog), which is not read: make a bag of it first, as by `ulog2rosbag` of pyulog"
    program = next((name for mark, name in _COMPRESSED.items() if head.startswith(mark)), None)
    return f"is compressed by {program}, which is not read: decompress it first" if program else ""


def instead(path: Path) -> str:
    """What to do where there is no file, as the rest of a sentence; empty where its name does not tell."""
    if _ADDRESS.match(str(path)):
        return ": it is an address; download the file first"
    pattern = not _OF_PATTERNS.isdisjoint(str(path))
    return f": patterns are for many recordings: `replay '{path}' --on SPEC…`" if pattern else ""


def why_no_file_of_a_bag(path: Path) -> str:
    """What a file is that begins as none of a bag does, as the rest of a sentence. Raises OSError."""
    with path.open("rb") as file:
        head = file.read(_HEAD)
    return what_it_is(head) or "is no file of a bag"
