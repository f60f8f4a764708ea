"""A server's specs: the files of the specs folder, and uploaded ones, which take precedence."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from oracle_server.core.errors import Finding, OracleError, SpecError
from oracle_server.core.plan import Plan, plan
from oracle_server.core.spec import Retention
from oracle_server.specfiles.load import SpecFile, load_spec, parse_spec


class UnknownSpecError(OracleError):
    """The library has no spec of that id."""


class FileVersion(NamedTuple):
    """Identifies a file's version; its time alone does not where it is written twice within some ms."""

    inode: int
    size: int
    modified: int
    changed: int


@dataclass(frozen=True, slots=True)
class Entry:
    """A spec of the library, its plan, and where it was read from."""

    file: SpecFile
    plan: Plan
    source: Literal["file", "put"]
    path: Path
    version: FileVersion | None


class Library:
    """Specs by id. A file that has changed is read again when its spec is next requested."""

    def __init__(self, folder: Path | None, uploads: Path) -> None:
        """Read all specs of both folders. Raises `SpecError` where one is refused, or two files have the same id."""
        self._uploads = uploads
        self._putting = threading.Lock()
        self._entries: dict[str, Entry] = {}
        for path in sorted(folder.glob("*.yaml")) if folder else ():
            entry = _read(path, "file")
            other = self._entries.setdefault(entry.file.spec.id, entry)
            if other is not entry:
                message = f"the id '{entry.file.spec.id}' is that of {other.path} already"
                raise SpecError([Finding(str(path), 1, 1, message)])
        for path in sorted(uploads.glob("*.yaml")):
            self._entries[path.stem] = _read(path, "put")

    def ids(self) -> list[str]:
        """The ids of all specs."""
        return sorted(self._entries)

    def last(self, spec_id: str) -> Entry:
        """A spec of `ids`, as of the last time that its file was sound."""
        return self._entries[spec_id]

    def retention(self) -> dict[str, Retention]:
        """The retention of each spec, by id."""
        return {spec_id: entry.plan.spec.retention for spec_id, entry in self._entries.copy().items()}

    def get(self, spec_id: str) -> Entry:
        """The present version of a spec. Raises `UnknownSpecError`, or `SpecError` where its file is unsound now."""
        entry = self._entries.get(spec_id)
        if entry is None:
            known = ", ".join(self.ids()) or "none"
            raise UnknownSpecError(f"there is no spec '{spec_id}'; known are {known}")
        version = _version(entry.path)
        if version is not None and version != entry.version:
            fresh = _read(entry.path, entry.source)
            if fresh.file.spec.id != spec_id:
                raise SpecError([Finding(str(entry.path), 1, 1, f"the id was '{spec_id}' and has changed")])
            self._entries[spec_id] = entry = fresh
        return entry

    def put(self, spec_id: str, text: str) -> tuple[Entry, bool]:
        """Store an uploaded spec; returns it, and whether its id is new. Raises `SpecError` where it is refused."""
        file = parse_spec(text, f"{spec_id}.yaml")
        if file.spec.id != spec_id:
            raise SpecError([Finding(f"{spec_id}.yaml", 1, 1, f"its id is '{file.spec.id}', not '{spec_id}'")])
        path = self._uploads / f"{spec_id}.yaml"
        with self._putting:
            new = spec_id not in self._entries
            _write(path, text)
            self._entries[spec_id] = entry = Entry(file, plan(file.spec), "put", path, _version(path))
        return entry, new


def _write(path: Path, text: str) -> None:
    """Write a file atomically, and durably even if the machine crashes. Raises OSError."""
    if not path.parent.exists():
        path.parent.mkdir(parents=True)
        _sync(path.parent.parent)
    draft = path.with_suffix(".draft")
    with draft.open("wb") as file:
        file.write(text.encode())
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
    _sync(path.parent)


def _sync(folder: Path) -> None:
    """Flush the entries of a folder to the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _read(path: Path, source: Literal["file", "put"]) -> Entry:
    version = _version(path)  # before reading: a change meanwhile is noticed the next time
    file = load_spec(path)
    return Entry(file, plan(file.spec), source, path, version)


def _version(path: Path) -> FileVersion | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return FileVersion(found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)
