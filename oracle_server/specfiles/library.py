"""A server's specs: the files of the specs folder, and uploaded ones, which take precedence.

Reading a spec can take seconds: on an event loop only the coroutines may be used, which read in threads.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import re
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

from oracle_server.core.errors import Finding, OracleError, SpecError
from oracle_server.core.plan import Plan, plan
from oracle_server.core.spec import Retention
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.document import MAX_TEXT
from oracle_server.specfiles.load import SpecFile, load_spec, parse_spec

T = TypeVar("T")

Expected = frozenset[str] | Literal["any", "none"] | None
"""What is to be there of a spec before another text takes its place: a text with one of these tags, any, none.

None where that does not matter.
"""

_NAMED = 5
"""How many unsound specs are named in a line."""
_ID = re.compile(r"""^id:[ \t]*["']?([A-Za-z0-9_.-]{1,64})["']?[ \t]*(?:#.*)?$""", re.MULTILINE)


class UnknownSpecError(OracleError):
    """The library has no spec of that id."""

    def __init__(self, spec_id: str, known: Sequence[str]) -> None:
        self.brief = f"there is no spec '{spec_id}'"
        """The text without the names of other specs."""
        super().__init__(f"{self.brief}; known are {', '.join(known) or 'none'}")


class SpecChangedError(OracleError):
    """A spec that is not what its sender believes it to be."""


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

    @property
    def id(self) -> str:
        """The spec's id."""
        return self.file.spec.id

    @property
    def tag(self) -> str:
        """What tells its text from other texts."""
        return hashlib.sha256(self.file.text.encode()).hexdigest()[:32]


@dataclass(frozen=True, slots=True)
class Unsound:
    """A file that can't be used: the id that it gives itself, else its name, and why."""

    id: str
    error: SpecError
    source: Literal["file", "put"]
    path: Path
    version: FileVersion | None


class Library:
    """Specs by id. A file that is new, has changed, or was unsound, is read when its spec is next requested."""

    def __init__(self, folder: Path | None, uploads: Path, types: Types | None = None) -> None:
        """Read all specs of both folders; those that are refused are kept as unsound, with the reasons.

        Of two files with the same id the first one counts, and the other is unsound; an upload goes before a file.
        Without `types` the types of messages are not checked. In place of a folder there may be one file.
        """
        self._types = types
        self._folder, self._uploads = folder, uploads
        self._reading, self._uploading = ThreadPoolExecutor(1, "spec reading"), ThreadPoolExecutor(1, "spec upload")
        self._changing = threading.Lock()
        """Held while the specs on hand change, and not while any is read."""
        self._refused: dict[Path, tuple[FileVersion, SpecError]] = {}
        """What is wrong with files that were sound before, in the version that was read last."""
        self._entries: dict[str, Entry | Unsound] = {}
        self._doubles: dict[Path, Unsound] = {}
        """Unsound files whose id is another one's, by path."""
        self._seen: dict[Path, FileVersion | None] = {}
        """Files of the folder that have been read: each is on hand, unsound, or behind an upload of its id.

        With the version in which each was looked at for an id that is new.
        """
        self._read_new()
        for path in sorted(uploads.glob("*.yaml")):
            found = _found(path, "put", types)
            if isinstance(found, Unsound):
                found = replace(found, id=path.stem)
            self._entries[path.stem] = found

    async def find(self, spec_id: str) -> Entry:
        """The present version of a spec, as `get` has it; a file that has changed is read in a thread."""
        entry = self._entries.get(spec_id)
        if isinstance(entry, Entry) and _version(entry.path) == entry.version is not None:
            return entry
        return await self.in_thread(partial(self.get, spec_id))

    async def in_thread(self, work: Callable[[], T]) -> T:
        """Do some work with the library in the one thread that reads."""
        return await asyncio.get_running_loop().run_in_executor(self._reading, work)

    async def upload(self, spec_id: str, text: str, expected: Expected = None) -> tuple[Entry, bool]:
        """Store an uploaded spec, as `put` does, in the one thread for that."""
        return await asyncio.get_running_loop().run_in_executor(self._uploading, self.put, spec_id, text, expected)

    def listed(self) -> list[Entry | Unsound]:
        """All specs by id, unsound ones as their files are now, and others as of the last time that they were sound."""
        self._look_again()
        with self._changing:
            specs = [*self._entries.values(), *self._doubles.values()]
        return sorted(specs, key=lambda e: (e.id, str(e.path)))

    def wanting(self) -> str:
        """That there is no spec, or which are unsound, in a line; empty where there is nothing to say."""
        specs = self.listed()
        unsound = [e for e in specs if isinstance(e, Unsound)]
        if not specs:
            return f"there is no spec yet: {self._folder} has no *.yaml; name another folder by --specs"
        which = ", ".join(e.id for e in unsound[:_NAMED]) + (", …" if len(unsound) > _NAMED else "")
        how = f"can't be used: {which}; `oracle-server specs` tells why"
        return f"{len(unsound)} of {len(specs)} specs are unsound, and {how}" if unsound else ""

    def retention(self) -> dict[str, Retention]:
        """The retention of each spec, by id."""
        sound = [entry for entry in self._entries.copy().values() if isinstance(entry, Entry)]
        return {entry.id: entry.plan.spec.retention for entry in sound}

    def get(self, spec_id: str) -> Entry:
        """The present version of a spec. Raises `UnknownSpecError`, or `SpecError` where its file is unsound now."""
        entry = self._entries.get(spec_id)
        if not isinstance(entry, Entry) or _version(entry.path) is None:
            self._look_again()
            entry = self._entries.get(spec_id)
        if entry is None:
            raise UnknownSpecError(spec_id, sorted(self._entries.copy()))
        if isinstance(entry, Unsound):
            raise entry.error
        version = _version(entry.path)
        if version is None or version == entry.version:
            return entry
        fresh = self._reread(entry, version)
        with self._changing:
            if self._entries.get(spec_id) is entry:
                self._entries[spec_id] = fresh
                return fresh
        return self.get(spec_id)  # it was put meanwhile

    def written(self, spec_id: str) -> str | None:
        """What stands in the file of a spec now, sound or not; None where it can't be read, or is too long."""
        entry = self._entries.get(spec_id)
        if entry is None:
            return None
        try:
            with entry.path.open("rb") as file:
                data = file.read(MAX_TEXT + 1)
        except OSError:
            return None
        return data.decode(errors="replace") if len(data) <= MAX_TEXT else None

    def _reread(self, entry: Entry, version: FileVersion) -> Entry:
        """What the file of a spec is now. Raises `SpecError`, for a version that was read already without a look."""
        known = self._refused.get(entry.path)
        if known is not None and known[0] == version:
            raise known[1]
        try:
            return _read_again(entry, self._types)
        except SpecError as error:
            self._refused[entry.path] = version, error
            raise

    def _read_new(self) -> None:
        """Read the files of the folder that were not there before, or have another id."""
        for path in _files(self._folder) if self._folder else ():
            version = _version(path)
            with self._changing:
                known = path in self._seen
                if known and self._seen[path] == version:
                    continue
                self._seen[path] = version
            if known and not self._has_another_id(path):
                continue
            found = _found(path, "file", self._types)
            with self._changing:
                self._take(found)

    def _has_another_id(self, path: Path) -> bool:
        """Whether a file of sound specs gives itself an id that it did not have."""
        own = _own_id(path)
        with self._changing:
            of_it = [e for e in (*self._entries.values(), *self._doubles.values()) if e.path == path]
        return own is not None and not any(isinstance(e, Unsound) or e.id == own for e in of_it)

    def _take(self, found: Entry | Unsound) -> None:
        """Take in a file of the specs folder, as unsound where its id is another file's already.

        One in the place of a file that is gone, as where that was renamed, is taken for it; an upload goes before.
        """
        first = self._entries.setdefault(found.id, found)
        if first is found or first.source == "put":
            return
        if _version(first.path) is None:
            self._seen.pop(first.path, None)
            self._entries[found.id] = found
            return
        if isinstance(found, Entry):
            message = f"the id '{found.id}' is that of {first.path} already; give one of them another id"
            error = SpecError([Finding(str(found.path), *_place_of_id(found.file.text), message)])
            found = Unsound(found.id, error, found.source, found.path, found.version)
        self._doubles[found.path] = found

    def _look_again(self) -> None:
        """Read new files, and unsound ones again that have changed, or whose id is free now."""
        self._read_new()
        with self._changing:
            unsound = [e for e in (*self._entries.values(), *self._doubles.values()) if isinstance(e, Unsound)]
        for old in unsound:
            version = _version(old.path)
            if version == old.version and self._is_taken(old):
                continue
            found = None if version is None else self._looked_at(old, version)
            with self._changing:
                if self._doubles.get(old.path) is old:
                    del self._doubles[old.path]
                elif self._entries.get(old.id) is old:
                    del self._entries[old.id]
                else:  # it was put anew meanwhile
                    continue
                if found is not None:
                    self._take(found)
                else:
                    self._seen.pop(old.path, None)

    def _is_taken(self, old: Unsound) -> bool:
        """Whether the id of an unsound file is still its own, or that of a spec whose file is there."""
        first = self._entries.get(old.id)
        return first is not None and (first is old or _version(first.path) is not None)

    def _looked_at(self, old: Unsound, version: FileVersion) -> Entry | Unsound:
        """What an unsound file is now."""
        found = _found(old.path, old.source, self._types)
        if old.source == "file" or found.id == old.id:
            return found
        message = f"its id is '{found.id}', not '{old.id}'"
        error = found.error if isinstance(found, Unsound) else SpecError([Finding(str(old.path), 1, 1, message)])
        return Unsound(old.id, error, "put", old.path, version)

    def put(self, spec_id: str, text: str, expected: Expected = None) -> tuple[Entry, bool]:
        """Store an uploaded spec; returns it, and whether its id is new.

        Raises `SpecError` where it is refused, and `SpecChangedError` where what is there is not as expected.
        """
        self._demand(spec_id, expected)  # before the text is read, which may be refused
        file = parse_spec(text, f"{spec_id}.yaml", types=self._types)
        if file.spec.id != spec_id:
            raise SpecError([Finding(f"{spec_id}.yaml", 1, 1, f"its id is '{file.spec.id}', not '{spec_id}'")])
        path, ready = self._uploads / f"{spec_id}.yaml", plan(file.spec)
        present = self._demand(spec_id, expected)
        with self._changing:
            if expected is not None and self._entries.get(spec_id) is not present:
                raise _changed(spec_id)
            new = not isinstance(self._entries.get(spec_id), Entry)
            _write(path, text)
            self._entries[spec_id] = entry = Entry(file, ready, "put", path, _version(path))
        return entry, new

    def _demand(self, spec_id: str, expected: Expected) -> Entry | Unsound | None:
        """What there is of a spec, as its file is now. Raises `SpecChangedError` where it is not as expected."""
        if expected is None:
            return None
        with contextlib.suppress(SpecError, UnknownSpecError):
            self.get(spec_id)
        present = self._entries.get(spec_id)
        if expected == "none" and present is not None:
            raise SpecChangedError(f"there is a spec '{spec_id}' already")
        if expected == "any" and present is None:
            raise SpecChangedError(f"there is no spec '{spec_id}'")
        if isinstance(expected, frozenset) and not (isinstance(present, Entry) and present.tag in expected):
            raise _changed(spec_id)
        return present


def _changed(spec_id: str) -> SpecChangedError:
    return SpecChangedError(f"spec '{spec_id}' was changed meanwhile: get it again, and compare")


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


def _read(path: Path, source: Literal["file", "put"], types: Types | None) -> Entry:
    version = _version(path)  # before reading: a change meanwhile is noticed the next time
    try:
        file = load_spec(path, types=types)
    except SpecError as error:
        if source != "put":
            raise
        file = replace(load_spec(path), warnings=error.findings)  # it was accepted when less was known of its types
    return Entry(file, plan(file.spec), source, path, version)


def _read_again(entry: Entry, types: Types | None) -> Entry:
    fresh = _read(entry.path, entry.source, types)
    if fresh.id != entry.id:
        raise SpecError([Finding(str(entry.path), 1, 1, f"the id was '{entry.id}' and has changed")])
    return fresh


def _found(path: Path, source: Literal["file", "put"], types: Types | None) -> Entry | Unsound:
    version = _version(path)
    try:
        return _read(path, source, types)
    except SpecError as error:
        return Unsound(_own_id(path) or path.name, error, source, path, version)


def _own_id(path: Path) -> str | None:
    """The id that an unsound file gives itself, None where none is found."""
    try:
        with path.open("rb") as file:
            text = file.read(MAX_TEXT).decode(errors="replace")
    except OSError:
        return None
    match = _ID.search(text)
    return match[1] if match else None


def _place_of_id(text: str) -> tuple[int, int]:
    match = _ID.search(text)
    if match is None:
        return (1, 1)
    return (text.count("\n", 0, match.start(1)) + 1, match.start(1) - match.start() + 1)


def _version(path: Path) -> FileVersion | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return FileVersion(found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)


def _files(place: Path) -> list[Path]:
    """The specs' files in a folder; the file itself where it is one. To read a pipe would wait for who writes to it."""
    if place.is_file():
        return [place]
    return sorted(path for path in (*place.glob("*.yaml"), *place.glob("*.yml")) if not path.is_fifo())
