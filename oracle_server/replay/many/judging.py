"""Judges one recording by all specs, wherever that is done, and tells it as rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import oracle_server
from oracle_server.core.errors import NotReadError, OracleError, TraceError, one_line
from oracle_server.core.events import By
from oracle_server.replay.conclusion import UNUSABLE
from oracle_server.replay.many.digest import Extent, digest, extent
from oracle_server.replay.many.noted import Noted
from oracle_server.replay.many.row import ErrorKind, Row
from oracle_server.replay.preparing import prepare
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import SpecFile, parse_spec

_EVERY = 256
Show = Callable[[float, int], None]
"""Takes which part of a recording is read, of 1, and how many events that were."""


def path_text(path: Path) -> str:
    """A path as it stands in rows, whatever bytes it has."""
    return str(path).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


@dataclass(frozen=True)
class Text:
    """A spec's text, from the file at `path`; `digest` is its SHA-256."""

    path: str
    text: str
    digest: str
    id: str
    properties: tuple[str, ...]


@dataclass(frozen=True)
class Question:
    """What is asked of each recording; `types` are folders of definitions."""

    specs: tuple[Text, ...]
    by: By | None = None
    strict: bool = False
    types: tuple[Path, ...] = ()
    types_digest: str | None = None
    version: str = oracle_server.__version__


class Task(NamedTuple):
    """One recording by some specs, by their indexes; `place` is its own among all recordings.

    `known` are the digests of recordings of its size of which results are there, with the specs that these are of.
    """

    place: int
    path: Path
    specs: tuple[int, ...]
    known: Mapping[str, frozenset[int]] = {}


class Unit(NamedTuple):
    """What one recording came to by one spec; `found` is the digest by which it is known already, without rows."""

    task: int
    spec: int
    rows: tuple[Row, ...] = ()
    found: str | None = None


class Begun(NamedTuple):
    """A recording is now judged by a spec."""

    task: int
    spec: int


@dataclass
class Judge:
    """Judges recordings, one after the other."""

    question: Question
    _files: dict[int, SpecFile] = field(default_factory=dict)

    def judge(self, task: Task, show: Show) -> Iterator[Begun | Unit]:
        """A recording's results, spec by spec, each with its begin before it."""
        try:
            before = extent(task.path)
            known = digest(task.path, before)
        except Exception as error:  # noqa: BLE001 -- the other recordings are judged all the same
            what = str(error) if isinstance(error, OracleError) else _defect(task, error)
            yield from (self.failed(task, i, what, "run") for i in task.specs)
            return
        there = task.known.get(known, frozenset())
        for i in task.specs:
            if i in there:
                yield Unit(task.place, i, found=known)
                continue
            yield Begun(task.place, i)
            yield self._judged(task, i, known, before, show)

    def _judged(self, task: Task, index: int, known: str, before: Extent, show: Show) -> Unit:
        try:
            rows = self._rows(task, index, known, before, show)
            if extent(task.path) != before:
                return self.failed(task, index, f"{task.path}: was written to while it was judged", "run")
        except OracleError as error:
            if not isinstance(error, TraceError) or isinstance(error, NotReadError):
                return self.failed(task, index, str(error), "run")
            return self.failed(task, index, str(error), "recording", known, before.size)
        except MemoryError:
            return self.failed(task, index, f"{task.path}: more memory is needed than there is", "run")
        except Exception as error:  # noqa: BLE001 -- the other recordings are judged all the same
            return self.failed(task, index, _defect(task, error), "run")
        return Unit(task.place, index, rows)

    def _rows(self, task: Task, index: int, known: str, before: Extent, show: Show) -> tuple[Row, ...]:
        question = self.question
        file = self._file(index)
        replay = prepare(file, task.path, question.by, question.types, self._types, strict=question.strict)
        noted, recording = Noted(file.spec), replay.recording
        for count, judged in enumerate(replay):
            noted.note(judged)
            if count % _EVERY == 0:
                show(recording.read / recording.size if recording.size else 0, replay.events)
        show(1, replay.events)
        given = self._given(task, index) | {"recording_digest": known, "recording_bytes": before.size}
        return tuple(Row(**given, **columns) for columns in noted.columns(replay))

    def failed(
        self,
        task: Task,
        index: int,
        error: str,
        kind: ErrorKind,
        known: str | None = None,
        size: int | None = None,
    ) -> Unit:
        """What is told of a recording that could not be judged by a spec: a row a property, with the error."""
        given = self._given(task, index) | {"recording_digest": known, "recording_bytes": size}
        given |= {"exit": UNUSABLE, "error": one_line(error), "error_kind": kind}
        names = self.question.specs[index].properties
        return Unit(task.place, index, tuple(Row(**given, property=name) for name in names))

    def _given(self, task: Task, index: int) -> dict[str, Any]:
        question, spec = self.question, self.question.specs[index]
        return {
            "recording": path_text(task.path),
            "spec": spec.id,
            "spec_path": spec.path,
            "spec_digest": spec.digest,
            "by": question.by,
            "strict": question.strict,
            "types_digest": question.types_digest,
            "version": question.version,
        }

    @cached_property
    def _types(self) -> Types:
        return Types(self.question.types)

    def _file(self, index: int) -> SpecFile:
        if index not in self._files:
            spec = self.question.specs[index]
            self._files[index] = parse_spec(spec.text, spec.path, types=self._types)
        return self._files[index]


def _defect(task: Task, error: Exception) -> str:
    return f"{task.path}: could not be judged, by a defect of oracle-server: {type(error).__name__}: {error}"


def failed(question: Question, task: Task, specs: Sequence[int], error: str) -> list[Unit]:
    """What is told where whoever judged a recording came to an end over it; the next run tries again."""
    judge = Judge(question)
    return [judge.failed(task, i, error, "run") for i in specs]
