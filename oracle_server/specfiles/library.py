"""The specs on hand: files of the specs folder, and those that were put over HTTP, which come first."""

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
    """A spec that is not on hand."""


class Look(NamedTuple):
    """What tells whether a file is as it was; its time alone does not where it is written twice within some ms."""

    inode: int
    size: int
    modified: int
    changed: int


@dataclass(frozen=True, slots=True)
class Entry:
    """A spec on hand, ready to judge by, and where it comes from."""

    file: SpecFile
    plan: Plan
    source: Literal["file", "put"]
    path: Path
    seen: Look | None


class Library:
    """Specs by id. A file that has changed is read again when its spec is next asked for."""

    def __init__(self, folder: Path | None, uploads: Path) -> None:
        """Read all specs of both folders. Raises `SpecError` where one is refused, or an id stands in two files."""
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
        """A spec of `ids` as it was last read and found sound."""
        return self._entries[spec_id]

    def retention(self) -> dict[str, Retention]:
        """How long histories are kept, by the specs' ids."""
        return {spec_id: entry.plan.spec.retention for spec_id, entry in self._entries.copy().items()}

    def get(self, spec_id: str) -> Entry:
        """A spec as it is now. Raises `UnknownSpecError`, or `SpecError` where its file has become unsound."""
        entry = self._entries.get(spec_id)
        if entry is None:
            known = ", ".join(self.ids()) or "none"
            raise UnknownSpecError(f"no spec '{spec_id}' is on hand; known are {known}")
        seen = _look(entry.path)
        if seen is not None and seen != entry.seen:
            fresh = _read(entry.path, entry.source)
            if fresh.file.spec.id != spec_id:
                raise SpecError([Finding(str(entry.path), 1, 1, f"the id was '{spec_id}' and has changed")])
            self._entries[spec_id] = entry = fresh
        return entry

    def put(self, spec_id: str, text: str) -> tuple[Entry, bool]:
        """Take in a spec, and tell whether it is new. Raises `SpecError` where it is refused."""
        file = parse_spec(text, f"{spec_id}.yaml")
        if file.spec.id != spec_id:
            raise SpecError([Finding(f"{spec_id}.yaml", 1, 1, f"its id is '{file.spec.id}', not '{spec_id}'")])
        path = self._uploads / f"{spec_id}.yaml"
        with self._putting:
            new = spec_id not in self._entries
            _keep(path, text)
            self._entries[spec_id] = entry = Entry(file, plan(file.spec), "put", path, _look(path))
        return entry, new


def _keep(path: Path, text: str) -> None:
    """Write a file that is whole and there after a crash of the machine too. Raises OSError."""
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
    """Have what a folder lists be on the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _read(path: Path, source: Literal["file", "put"]) -> Entry:
    seen = _look(path)  # before it is read: what is written meanwhile is read the next time
    file = load_spec(path)
    return Entry(file, plan(file.spec), source, path, seen)


def _look(path: Path) -> Look | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return Look(found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)
