"""The command `init`: a first spec with a recording, to be changed into one's own; or the examples of the documents."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath

from oracle_server.core.errors import OracleError
from oracle_server.core.spec import IDENTIFIER

_NAME = "ROBOT"
"""What stands for the name in the files."""
_SHIPPED = ("examples", "specs")
"""Folders of the project whose files a wheel has in `shipped`."""


class InitError(OracleError):
    """A folder that can't be begun."""


def begin(folder: Path) -> list[Path]:
    """Write a spec, a recording and what to do with them into a new or empty folder. Raises `InitError`."""
    name = folder.resolve().name
    if not re.fullmatch(IDENTIFIER, name):
        raise InitError(
            f"{folder}: '{name}' can't be the spec's name: take letters from a to z, digits, `_`, `-` and `.`"
        )
    starter = dict(_below(files("oracle_server").joinpath("starter"), PurePosixPath()))
    texts = {path: file.read_text(encoding="utf-8").replace(_NAME, name) for path, file in starter.items()}
    return _write(folder, {path: text.encode() for path, text in texts.items()})


def begin_examples(folder: Path) -> list[Path]:
    """Write the specs and examples into a new or empty folder, where the documents' commands find them.

    Raises `InitError`.
    """
    shipped = files("oracle_server").joinpath("shipped")
    place: Traversable = shipped if shipped.is_dir() else Path(__file__).parents[2]  # a checkout has them at its top
    found = (each for name in _SHIPPED for each in _below(place.joinpath(name), PurePosixPath(name)))
    return _write(folder, {path: file.read_bytes() for path, file in found})


def _below(place: Traversable, path: PurePosixPath) -> Iterator[tuple[PurePosixPath, Traversable]]:
    """All files below a folder, each with its path there."""
    for each in sorted(place.iterdir(), key=lambda each: each.name):
        if each.is_dir():
            yield from _below(each, path / each.name)
        else:
            yield path / each.name, each


def _write(folder: Path, contents: Mapping[PurePosixPath, bytes]) -> list[Path]:
    paths = [folder / path for path in contents]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InitError(f"{folder}: there is something in it; name a folder that is new or empty")
        try:
            for path, content in zip(paths, contents.values(), strict=True):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
        except BaseException:  # Ctrl-C, too
            _delete(folder, paths)
            raise
    except OSError as error:
        raise InitError(f"{folder}: can't be written: {error.strerror or error}") from None
    return paths


def _delete(folder: Path, paths: Iterable[Path]) -> None:
    """Delete what was written of some files, so that the same command does it all once there is room."""
    with suppress(OSError):  # what keeps from writing may keep from this; why is told already
        for path in paths:
            path.unlink(missing_ok=True)
        for place, _, _ in os.walk(folder, topdown=False):
            if Path(place) != folder:
                Path(place).rmdir()
