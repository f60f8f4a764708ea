"""The recordings that are meant by paths: files, bags, folders of recordings, and patterns."""

from __future__ import annotations

import glob
import os
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from oracle_server.core.errors import TraceError
from oracle_server.replay.files.folder import MAGICS, METADATA, begins_as
from oracle_server.replay.files.ros1file import MAGIC as ROS1
from oracle_server.replay.files.strangers import is_named, is_named_compressed
from oracle_server.replay.opening import is_recording

_LOG = ".jsonl"
"""What logs are called: a file that is called so, or as those of bags are, is a recording whatever it holds."""
_NUMBERED = frozenset(MAGICS) - {ROS1}
"""How the files begin that `ros2 bag` numbers."""


class Gathered(NamedTuple):
    """Recordings, each once, how many other files their folders have, and folders by links, which are passed over."""

    recordings: list[Path]
    others: int
    links: list[Path]


def gather(arguments: Sequence[Path], without: Collection[Path] = ()) -> Gathered:
    """The recordings in the order of the arguments; those of a folder by their names, its folders included.

    A path that is not there may be a pattern, as `bags/**/*.bag`; what else is not there is a recording that can't be
    read. The files `without`, where results go, are passed over: a pattern names them with the recordings. Raises
    `TraceError` where there is none.
    """
    found: dict[Path, None] = {}
    others, links = 0, list[Path]()
    passed = {path.absolute() for path in without}
    for argument in arguments:
        named = _matching(argument) if not argument.exists() and glob.has_magic(str(argument)) else [argument]
        for path in named:
            if not path.is_dir() or _is_one(path):
                found[path] = None
                continue
            inside = _inside(path, passed)
            found |= dict.fromkeys(inside.recordings)
            others += inside.others
            links += inside.links
    kept = [path for path in found if path.absolute() not in passed]
    if not kept:
        named_so = ", ".join(map(str, arguments))
        what = "results go there, as --out says" if found else "has no recordings: no bags, and no logs in JSON Lines"
        raise TraceError(f"{named_so}: {what}")
    return Gathered(kept, others, [link for link in links if link not in arguments])


def _matching(pattern: Path) -> list[Path]:
    found = sorted(Path(name) for name in glob.glob(str(pattern), recursive=True))
    if not found:
        raise TraceError(f"{pattern}: there is no such file, and none of this pattern")
    return found


def _is_one(folder: Path) -> bool:
    return folder.suffix == ".jsonl" or _is_bag(folder)


def _is_bag(folder: Path) -> bool:
    """Whether a folder is one bag: it has metadata, or else files that `ros2 bag` has numbered after it."""
    if (folder / METADATA).exists():
        return True
    try:
        return any(_begins(path) for path in folder.glob(f"{glob.escape(folder.name)}_[0-9]*"))
    except OSError:
        return False


def _begins(path: Path) -> bool:
    return path.is_file() and begins_as(path) in _NUMBERED


def _inside(folder: Path, passed: Collection[Path]) -> Gathered:
    found, links = list[Path](), list[Path]()
    others = 0
    for path in _walk(folder):
        if path.is_dir():
            (links if path.is_symlink() and not _is_one(path) else found).append(path)
        elif path.absolute() in passed:
            continue
        elif _is_named(path) or (path.is_file() and is_recording(path)):
            found.append(path)
        else:
            others += 1
    return Gathered(found, others, links)


def _is_named(path: Path) -> bool:
    """Whether a file is called as recordings are, compressed ones included."""
    return is_named(path) or path.suffix == _LOG or is_named_compressed(path, _LOG)


def _walk(folder: Path) -> Iterator[Path]:
    """Files and bags below a folder, by their names, and folders by links; hidden ones are passed over."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError as error:
        raise TraceError(f"{folder}: can't be read: {error.strerror}") from None
    for entry in entries:
        path = folder / entry.name
        if entry.name.startswith("."):
            continue
        if entry.is_dir():
            if entry.is_symlink() or _is_one(path):
                yield path
            else:
                yield from _walk(path)
        else:
            yield path
