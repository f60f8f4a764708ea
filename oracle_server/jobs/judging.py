"""A process that judges one recording by the same code as `replay`, and tells what comes of it row by row."""

from __future__ import annotations

import os
import resource
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import msgspec

from oracle_server.core.errors import OracleError, SpecError, TraceError, one_line
from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Judged
from oracle_server.history.episodes import going_on, stored_episodes
from oracle_server.history.records import Document, StoredStep, stored, stored_revision
from oracle_server.jobs.frames import Ended, Failed, Progress, Rows, Started, Task
from oracle_server.process.rlimits import bound, memory
from oracle_server.process.worker import receive, send, step_back
from oracle_server.replay.conclusion import conclude
from oracle_server.replay.opening import open_recording
from oracle_server.replay.preparing import doubtful
from oracle_server.replay.run import Replay
from oracle_server.rostypes.known import Types
from oracle_server.rostypes.streams import stream_types
from oracle_server.sessions.status import judged_state
from oracle_server.specfiles.load import SpecFile, parse_spec

MEMORY = 3 * 2**30
"""Bytes of address space that a recording may take."""
_NICE = 5
_TOGETHER, _AT_ONCE = 64, 2**19
"""Rows that are told at once, and their bytes: the server takes them in at one go, while robots' decisions wait."""
LARGEST = 2**20
"""The most bytes of a step, as much as a frame of a monitor's may have; that of a recording may be any."""
_EVERY = 0.5
"""Seconds between two frames that tell how far it has got."""
_SMALL = 2**16
"""Bytes of a state up to which each of these has it; a larger one comes more seldom: the server reads it at one go."""
_FURTHER = 3
"""What else is told at most of a recording that can't be used."""
_MOST, _LONGEST = 200, 2_000
"""Notes on a recording, and characters of one."""
_FAILURES = (OracleError, MemoryError, OverflowError, OSError)
"""What ends the judging of a recording, whatever is wrong with it."""
_encode = msgspec.msgpack.Encoder().encode
_task = msgspec.msgpack.Decoder(Task).decode


class Telling:
    """The frames that are told, by two threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()

    def tell(self, frame: object) -> None:
        """Tell a frame; the process ends where nobody listens any more."""
        with self._lock:
            try:
                send(sys.stdout.buffer, frame)
            except BrokenPipeError:
                os._exit(1)


class Told(Replay):
    """A replay that gives its rows on as they are judged."""

    tap: Callable[[list[Judged]], None]

    def outputs(self) -> Iterator[list[Judged]]:
        """What the session gives, each list given on before."""
        for judged in super().outputs():
            self.tap(judged)
            yield judged

    def handled(self, judged: Judged) -> tuple[bool, str] | None:
        """What the adapter did with an event that was judged, where that is recorded."""
        event = judged.step.event
        take = self.passed.get if self.revises else self.passed.pop
        found = take((event.monitor, event.seq), None) if self.passed else None
        return None if found is None else (found[0], found[1] or "decision")


class Rowed:
    """The rows of a replay, told so many at once; what is judged in one pass stays together."""

    def __init__(self, replay: Told, tell: Callable[[object], None]) -> None:
        self._replay, self._tell = replay, tell
        self._names = tuple([p.id for p in replay.spec.properties])
        self._waiting: list[Rows] = []
        self._count = self._size = self._position = 0
        self._begun, self._whole = False, True

    def take(self, judged: list[Judged]) -> None:
        """Take in what was judged together."""
        if not self._begun:
            self._begin()
        together = self._replay.revises
        for group in filter(None, [judged] if together else [[item] for item in judged]):
            rows = self._rows(group)
            self._waiting.append(rows)
            self._count += len(group)
            self._size += _size(rows)
            if self._count >= _TOGETHER or self._size >= _AT_ONCE:
                self.flush()

    def flush(self) -> None:
        """Tell the rows that there are; those before one that can't be told. Raises `OverflowError` then."""
        waiting, self._waiting, self._count, self._size = self._waiting, [], 0, 0
        if not waiting:
            return
        told, self._whole = self._whole, False
        try:
            self._tell(_joined(waiting))
        except OverflowError:
            for rows in waiting:
                self._tell(rows)
            raise
        self._whole = told

    def finish(self) -> None:
        """Tell the rows that there are, and the episodes that end with the session. Raises as `flush`.

        Where a row could not be told, what was judged of it is not what the session ends with.
        """
        self.flush()
        session = self._replay.session
        ended = [] if session is None else going_on(session.judges, self._names, closed=True)
        if ended and self._whole:
            self._tell(Rows([], [], ended))

    def last(self) -> Document | None:
        """Tell the rows that there are; returns how the session stands by all, None where that is not known."""
        if not self._begun:
            return None
        try:
            self.finish()
        except (MemoryError, OverflowError):
            return None
        return _state(self._replay) if self._whole else None

    def _begin(self) -> None:
        self._begun = True
        replay, session = self._replay, self._replay.session
        assert session is not None  # noqa: S101 -- it has judged
        by = None if replay.spec.ordering.by == replay.asked_by else replay.spec.ordering.by
        self._tell(Started(by, next(iter(session.judges)), session.begun))

    def _rows(self, group: list[Judged]) -> Rows:
        rows = Rows([], [], [])
        for item in group:
            row = self._stored(item)
            self._demand_size(row)
            rows.steps.append(row)
            rows.episodes += stored_episodes(item, self._names, row.explanations)
            if isinstance(item, Revision):
                rows.revisions.append(item)
        return rows

    def _demand_size(self, row: StoredStep) -> None:
        """Raise `TraceError` for a step that is larger than the server takes."""
        size = _size((row.step, row.why))
        if size > LARGEST:
            self._whole = False
            raise TraceError(
                f"{self._replay.recording.path}: an event of {row.step.event.stream} has {size} bytes of signals, and"
                f" the server keeps {LARGEST} of one: have the spec read no such long texts, or judge it by"
                " `oracle-server replay`"
            )

    def _stored(self, item: Judged) -> StoredStep:
        self._position += 1
        if isinstance(item, Revision):
            return stored_revision(self._position, item)
        row = stored(self._position, 0, item, self._replay.handled(item))
        event = msgspec.structs.replace(row.step.event, data=None)
        return msgspec.structs.replace(row, step=msgspec.structs.replace(row.step, event=event))


def _size(told: object) -> int:
    """Bytes by which something is told; as if it were much, where it has what can't be."""
    try:
        return len(_encode(told))
    except OverflowError:
        return _AT_ONCE  # so that it is tried at once, and refused


def _joined(rows: Sequence[Rows]) -> Rows:
    return Rows(
        [step for each in rows for step in each.steps],
        [revision for each in rows for revision in each.revisions],
        [episode for each in rows for episode in each.episodes],
    )


def judge(task: Task, tell: Callable[[object], None]) -> None:
    """Judge a recording, and tell its frames, `Failed` last where it can't be judged to its end."""
    try:
        folders = [Path(os.fsdecode(folder)) for folder in task.types]
        known = Types(folders)
        file = _spec(task.spec, known)
        warnings = doubtful(file)
        recording = open_recording(Path(os.fsdecode(task.recording)), file.spec, folders)
        shapes, _ = stream_types(file.spec, known, None)
        replay = Told(file.spec, recording, types=shapes, warnings=warnings)
    except _FAILURES as error:
        tell(Failed(_why(task, error)))
        return
    rows = Rowed(replay, tell)
    replay.tap = rows.take
    try:
        _judge(replay, rows, tell)
        end = conclude(replay)
    except _FAILURES as error:
        tell(Failed(_why(task, error), rows.last()))
        return
    if end.unusable:
        why = (*end.unusable, *end.doubts[:_FURTHER])  # of what could not be read nothing else tells
        tell(Failed("; ".join(_named(task, why)), rows.last()))
        return
    conclusion = end.as_data() | {"ignored": sum(recording.ignored.values())}
    for texts in ("notes", "doubts", "warnings"):
        conclusion[texts] = _named(task, conclusion[texts])
    tell(Ended(_state(replay), conclusion))


def _judge(replay: Told, rows: Rowed, tell: Callable[[object], None]) -> None:
    """Judge all of it, and tell the rows, and how far it has got."""
    recording, ended = replay.recording, threading.Event()

    def far() -> Progress:
        return Progress(replay.events, recording.read, recording.size)

    def tell_often() -> None:
        while not ended.wait(_EVERY):
            tell(far())

    often = threading.Thread(target=tell_often, daemon=True)
    often.start()
    try:
        due = time.monotonic() + _EVERY
        for _ in replay:
            if time.monotonic() > due:
                state = _state(replay)
                tell(msgspec.structs.replace(far(), state=state))
                due = time.monotonic() + _EVERY * max(1.0, _size(state) / _SMALL)
        rows.finish()
    finally:
        ended.set()
        often.join()
        tell(far())


def _why(task: Task, error: BaseException) -> str:
    """Why it can't be judged to its end."""
    if isinstance(error, OracleError):
        return "; ".join(_named(task, str(error).splitlines()))
    if isinstance(error, MemoryError):
        return f"{task.name}: it needs more than {memory(MEMORY)}"
    if isinstance(error, OverflowError):
        return f"{task.name}: it has a whole number beyond 64 bits, which can't be kept"
    assert isinstance(error, OSError)  # noqa: S101 -- as `_FAILURES` has it
    return f"{task.name}: can't be read: {error.strerror or error}"


def _named(task: Task, texts: Iterable[str]) -> list[str]:
    """Some texts about a recording, a line each, in which it has its sender's name; so many of them at most."""
    path = os.fsdecode(task.recording)
    folder = f"{Path(path).parent}/"
    told = [one_line(text.replace(path, task.name).replace(folder, "")) for text in texts]
    return [text[:_LONGEST] for text in told[:_MOST]]


def _state(replay: Replay) -> Document:
    session = replay.session
    assert session is not None  # noqa: S101 -- it has events
    return judged_state(session, session.now, 0)


def _spec(text: str, known: Types) -> SpecFile:
    try:
        return parse_spec(text, "spec", types=known)
    except SpecError:  # it was accepted when less was known of its types
        return parse_spec(text, "spec")


def main() -> None:
    """Judge what the standard input asks for."""
    step_back(_NICE)
    task = _task(receive(sys.stdin.buffer))
    bound(resource.RLIMIT_AS, MEMORY)
    bound(resource.RLIMIT_FSIZE, task.most_bytes)
    bound(resource.RLIMIT_CORE, 0)
    os.environ["TMPDIR"] = str(Path(os.fsdecode(task.recording)).parent)  # what is unpacked goes with it
    judge(task, Telling().tell)


if __name__ == "__main__":
    main()
