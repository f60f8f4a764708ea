"""Where results go: to a table whose journal keeps them until all are there, or to standard output in their order."""

from __future__ import annotations

import itertools
import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from oracle_server.replay.many.journal import Journal
from oracle_server.replay.many.judging import Question, Unit, path_text
from oracle_server.replay.many.row import Key, Row, key_of
from oracle_server.replay.many.tablefile import ResultsError, format_of, read_rows

Rows = tuple[Row, ...]
_Result = tuple[str, int]
"""The digest of a recording, and the index of a spec."""


class _Name(NamedTuple):
    """What a unit is told apart by from others: the paths, and what was judged of them."""

    recording: str
    spec: str
    key: Key | None


class Beside(NamedTuple):
    """The files of a table: itself, and those beside it."""

    table: Path
    journal: Path
    part: Path
    """The table while it is written."""
    old: Path
    """What was in the table or its journal, and is no answer to what is asked now."""

    @classmethod
    def of(cls, table: Path) -> Beside:
        """Those of a table."""
        return cls(table, *(table.with_name(f"{table.name}.{end}") for end in ("journal", "part", "old")))


class Kept:
    """A table of results: what is in it or its journal by digest is known, and need not be judged."""

    def __init__(self, files: Beside, question: Question, recordings: Sequence[Path]) -> None:
        """Open the journal, with all that the table has. Raises `ResultsError`."""
        self._files, self._format = files, format_of(files.table)
        self._question, self._recordings = question, recordings
        if not files.table.parent.is_dir():
            raise ResultsError(f"--out {files.table}: there is no such folder")
        self._there: dict[_Name, int] = {}
        """Where each unit stands that was there before."""
        self._sound: dict[_Result, int] = {}
        self._broken: dict[tuple[str, _Result], int] = {}
        """Of recordings that can't be used, by their paths, which the errors name."""
        self._candidates: defaultdict[int | str, set[_Result]] = defaultdict(set)
        """What may be known, by a recording's size, or by its path."""
        self._placed: dict[tuple[int, int], int] = {}
        self._used: set[Key | None] = set()
        self._journal = Journal(files.journal)
        try:
            self._load()
        except BaseException:
            self._journal.close()
            raise

    def close(self) -> None:
        """Let go of the journal, with what is in it."""
        self._journal.close()

    def known(self, path: Path, size: int) -> dict[str, frozenset[int]]:
        """By the digests that a recording may have: the specs of which there are results."""
        found: defaultdict[str, set[int]] = defaultdict(set)
        for digest, spec in self._candidates.get(size, set()) | self._candidates.get(path_text(path), set()):
            found[digest].add(spec)
        return {digest: frozenset(specs) for digest, specs in found.items()}

    def take(self, unit: Unit) -> Rows:
        """Keep a result, or find the one that is there; its rows."""
        if unit.found is None:
            at, rows = self._journal.add(unit.rows), unit.rows
        else:
            at = self._find(unit.found, unit)
            rows = self._journal.read(at)
        self._placed[unit.task, unit.spec] = at
        self._used.add(key_of(rows[0]))
        return rows

    def finish(self) -> int:
        """Write the table; returns how many results of other recordings or specs were there, now in a file beside."""
        self._write(self._files.table, self._rows())
        others = self._others()
        if others:
            self._write(self._files.old, itertools.chain.from_iterable(map(self._journal.read, others)))
        self._journal.remove()
        return len(others)

    def _load(self) -> None:
        for at, rows in self._journal.lines():
            self._note(at, rows)
        if not self._files.table.exists():
            return
        for _, group in itertools.groupby(read_rows(self._files.table), _name):
            rows = tuple(group)
            if _name(rows[0]) not in self._there:
                self._note(self._journal.add(rows), rows)
        self._journal.sync()

    def _note(self, at: int, rows: Rows) -> None:
        row, key = rows[0], key_of(rows[0])
        self._there[_name(row)] = at
        if key is None or row.recording_bytes is None:
            return
        for i in range(len(self._question.specs)):
            if key == self._key(key.recording, i):
                result = (key.recording, i)
                if row.error is None:
                    self._sound[result] = at
                    self._candidates[row.recording_bytes].add(result)
                else:
                    self._broken[row.recording, result] = at
                    self._candidates[row.recording].add(result)

    def _key(self, digest: str, spec: int) -> Key:
        asked = self._question
        return Key(digest, asked.specs[spec].digest, asked.by, asked.strict, asked.types_digest, asked.version)

    def _find(self, digest: str, unit: Unit) -> int:
        result = (digest, unit.spec)
        sound = self._sound.get(result)
        return self._broken[path_text(self._recordings[unit.task]), result] if sound is None else sound

    def _rows(self) -> Iterator[Row]:
        for (task, spec), at in sorted(self._placed.items()):
            asked = self._question.specs[spec]
            for row in self._journal.read(at):
                yield msgspec.structs.replace(row, recording=path_text(self._recordings[task]), spec_path=asked.path)

    def _others(self) -> list[int]:
        """Where results stand that were there before, and are no part of the table."""
        paths = set(map(path_text, self._recordings))
        specs = {spec.path for spec in self._question.specs}
        return [
            at
            for name, at in self._there.items()
            if (name.key not in self._used if name.key else name.recording not in paths or name.spec not in specs)
        ]

    def _write(self, path: Path, rows: Iterator[Row]) -> None:
        """Write a table as a whole, or not at all."""
        part = self._files.part
        try:
            with part.open("wb") as out:
                self._format.write(rows, out)
                out.flush()
                os.fsync(out.fileno())
            part.replace(path)
        except OSError as error:
            raise ResultsError(f"{path}: can't be written: {error.strerror or error}") from None


class Told:
    """Results that are told in the order of the recordings, each as soon as all before it are there."""

    def __init__(self, tell: Callable[[Rows], None], specs: int) -> None:
        self._tell, self._specs = tell, specs
        self._waiting: dict[tuple[int, int], Rows] = {}
        self._next = (0, 0)

    def known(self, path: Path, size: int) -> dict[str, frozenset[int]]:
        """Nothing is."""
        del path, size
        return {}

    def take(self, unit: Unit) -> Rows:
        """Tell a result, or keep it until its turn."""
        self._waiting[unit.task, unit.spec] = unit.rows
        while (rows := self._waiting.pop(self._next, None)) is not None:
            self._tell(rows)
            task, spec = self._next
            self._next = (task, spec + 1) if spec + 1 < self._specs else (task + 1, 0)
        return unit.rows

    def finish(self) -> int:
        """All is told."""
        return 0

    def close(self) -> None:
        """Nothing is open."""


def _name(row: Row) -> _Name:
    return _Name(row.recording, row.spec_path, key_of(row))
