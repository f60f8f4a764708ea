"""Definitions in files: of a folder that is named, read at once; of what is sourced, when they are asked for."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

from oracle_server.core.errors import OracleError
from oracle_server.rostypes.definition import DefinitionError, Fields, read_definition

KINDS = ("msg", "srv", "action")
PARTS = {"srv": ("_Request", "_Response"), "action": ("_Goal", "_Result", "_Feedback")}
"""What the names of a definition's messages end with, where it has several."""
_SHARES = (("AMENT_PREFIX_PATH", "share"), ("CMAKE_PREFIX_PATH", "share"), ("ROS_PACKAGE_PATH", ""))
"""The variables that name what is sourced, and where the packages are in each of their folders."""
_MOST = 1_000_000
"""Most characters of a definition."""
_NAME = re.compile(r"<name>\s*([A-Za-z]\w*)\s*</name>")
_ABOVE = 3
"""So many folders above a definition's own may be its package's."""


class TypesError(OracleError):
    """Definitions of types that can't be used; the text has a line for each file."""


def definitions(folder: Path, kinds: Sequence[str] = KINDS) -> list[tuple[Path, str]]:
    """The files below a folder that define types, each with its package, or several that it may be of.

    A package is called as its `package.xml` says, whatever its folder is called, and has files in folders of its own,
    as `pkg/parts/msg/Name.msg`. Without one it is called as its folder: `pkg/msg/Name.msg`, or `pkg/Name.msg`. Where
    both may be meant both are there, and what is sure comes first.
    """
    names: dict[Path, list[tuple[int, str]]] = {}
    found = []
    for kind in kinds:
        for path in sorted(folder.rglob(f"*.{kind}")):
            own = (path.parent.parent if path.parent.name == kind else path.parent).resolve()
            if own not in names:
                names[own] = _packages_of(own)
            found += [(rank, path, package) for rank, package in names[own]]
    return [(path, package) for _, path, package in sorted(found, key=lambda each: each[0])]


def _packages_of(folder: Path) -> list[tuple[int, str]]:
    """What the package of a folder may be called, and in which rank: the least is the surest."""
    for above, at in enumerate((folder, *folder.parents[:_ABOVE])):
        name = _declared(at)
        if name:
            return [(1, folder.name), (2, name)] if above else [(0, name)]
    return [(1, folder.name)]


def _declared(folder: Path) -> str:
    """What a folder's `package.xml` calls the package; empty where there is none, or none that can be read."""
    try:
        match = _NAME.search((folder / "package.xml").read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return ""
    return match[1] if match else ""


def read_folder(folder: Path) -> dict[str, Fields]:
    """All messages that the files below a folder define, by their full names. Raises `TypesError`."""
    defined = definitions(folder) if folder.is_dir() else []
    if not defined:
        what = "has no .msg, .srv or .action files" if folder.is_dir() else "is no folder"
        raise TypesError(f"{folder}: {what}; name the folder of a package or of a workspace")
    found: dict[str, Fields] = {}
    wrong: dict[str, None] = {}
    for path, package in defined:
        try:
            for name, fields in read_file(path, package).items():
                found.setdefault(name, fields)
        except TypesError as error:
            wrong[str(error)] = None
    if wrong:
        raise TypesError("\n".join(wrong))
    return found


def read_file(path: Path, package: str) -> dict[str, Fields]:
    """The messages that a file defines. Raises `TypesError` with its line."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise TypesError(f"{path}: can't be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise TypesError(f"{path}:1: not UTF-8 text") from None
    if len(text) > _MOST:
        raise TypesError(f"{path}:1: has more than {_MOST} characters")
    try:
        return read_definition(text, package, path.suffix[1:], path.stem)
    except DefinitionError as error:
        raise TypesError(f"{path}:{error.line}: {error}") from None


class Workspace:
    """The packages that are sourced, as the environment names them; files are read when a package is asked for."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        """`environment` is by default this process's."""
        self._environment = os.environ if environment is None else environment
        self._read: dict[str, dict[str, Fields | None]] = {}
        self.unreadable: dict[str, str] = {}
        """Why definitions can't be read, by the files' paths."""

    @cached_property
    def packages(self) -> Mapping[str, Sequence[Path]]:
        """The folders of the packages that define types, by name; the first that is sourced comes first."""
        found: dict[str, list[Path]] = {}
        for variable, below in _SHARES:
            for prefix in filter(None, self._environment.get(variable, "").split(os.pathsep)):
                for folder in _folders(Path(prefix) / below if below else Path(prefix), below):
                    found.setdefault(folder.name, []).append(folder)
        return found

    def types(self, package: str) -> Mapping[str, Fields | None]:
        """The messages of a package by full names; None for one whose definition can't be read."""
        if package not in self._read:
            known = self._read[package] = {}
            for folder in self.packages.get(package, ()):
                for path in sorted(path for kind in KINDS for path in (folder / kind).glob("*.*")):
                    for name, fields in self._definition(path, package).items():
                        if known.get(name) is None:
                            known[name] = fields
        return self._read[package]

    def _definition(self, path: Path, package: str) -> Mapping[str, Fields | None]:
        if path.suffix[1:] in KINDS:
            try:
                return read_file(path, package)
            except TypesError as error:
                self.unreadable[str(path)] = str(error)
        elif path.suffix != ".idl":
            return {}
        prefix = f"{package}/{path.parent.name}/{path.stem}"
        return dict.fromkeys([f"{prefix}{part}" for part in PARTS.get(path.parent.name, ("",))])


def _folders(share: Path, below: str) -> list[Path]:
    """The folders of packages in a folder; one of `ROS_PACKAGE_PATH` may be a package, or hold them in stacks."""
    try:
        inner = sorted(path for path in share.iterdir() if path.is_dir())
    except OSError:
        return []
    own = [share] if not below and _defines(share) else []
    found = [path for path in inner if _defines(path)]
    if not below:
        found += [path for stack in inner if stack not in found for path in _folders_in(stack)]
    return own + found


def _folders_in(stack: Path) -> list[Path]:
    try:
        return [path for path in sorted(stack.iterdir()) if path.is_dir() and _defines(path)]
    except OSError:
        return []


def _defines(folder: Path) -> bool:
    return any((folder / kind).is_dir() for kind in KINDS)
