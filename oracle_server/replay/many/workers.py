"""Processes of this machine that judge recordings, one each at a time; none of them is stopped by another's end."""

from __future__ import annotations

import gc
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from oracle_server.replay.many.judging import Begun, Judge, Question, Task, Unit, failed

_SPAWN = multiprocessing.get_context("spawn")
_TOLD_EVERY = 0.3
"""Seconds between two words on how far a recording is read."""
_MANY = 200_000
"""Objects beyond which it is looked whether all of them are still needed; the modules make half of them."""
_END = 5.0
"""Seconds within which a process that was killed is gone."""


class Progress(NamedTuple):
    """How much of a recording is read, of 1 for all specs, and how many events that were since it was last said."""

    task: int
    part: float
    events: int


class Ended(NamedTuple):
    """A recording is judged by all specs."""

    task: int


Said = Unit | Progress | Ended


class Workers:
    """Judges recordings in processes; `timeout` (s) is how long one spec may take for one recording, None for ever."""

    def __init__(self, question: Question, count: int, timeout: float | None) -> None:
        self._question, self._count, self._timeout = question, count, timeout

    def run(self, tasks: Sequence[Task]) -> Iterator[Said]:
        """What is said of the recordings, in any order; all of it of one before its `Ended`."""
        waiting = deque(tasks)
        workers = [_Worker(self._question) for _ in range(min(self._count, len(tasks)))]
        try:
            while True:
                for worker in workers:
                    if worker.task is None and waiting:
                        worker.give(waiting.popleft())
                busy = {worker.connection: worker for worker in workers if worker.task is not None}
                if not busy:
                    return
                for ready in wait(list(busy), self._until_next(workers)):
                    yield from busy[ready].read()  # type: ignore[index]
                for i, worker in enumerate(workers):
                    why = worker.ended() or worker.overdue(self._timeout)
                    if why is not None:
                        rest, said = worker.end(why)
                        workers[i] = _Worker(self._question)
                        yield from said
                        if rest is not None:
                            waiting.appendleft(rest)
        finally:
            for worker in workers:
                worker.kill()

    def _until_next(self, workers: Sequence[_Worker]) -> float | None:
        """Seconds until the first recording has taken too long."""
        if self._timeout is None:
            return None
        first = min(worker.since for worker in workers if worker.task is not None)
        return max(0.0, first + self._timeout - time.monotonic())


@contextmanager
def _apart() -> Iterator[None]:
    """What is started here is not ended by Ctrl-C, but by who starts it, and has no module of the folder it is in.

    It would begin with a struct.py of a bag's otherwise. This process's environment is as it was behind it.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    safe = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if safe is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = safe


class _Worker:
    """One process, what it judges, and since when (monotonic, s)."""

    def __init__(self, question: Question) -> None:
        self._question = question
        self.connection, theirs = _SPAWN.Pipe()
        self._folder = _folder()
        place = None if self._folder is None else self._folder.name
        self._process: SpawnProcess = _SPAWN.Process(target=_work, args=(question, theirs, place), daemon=True)
        self.task: Task | None = None
        self.since = 0.0
        self._left: list[int] = []
        """The specs whose results are not there yet, in the order in which they come."""
        self._dead = False
        with _apart():
            self._process.start()
        theirs.close()

    def give(self, task: Task) -> None:
        self.task, self._left, self.since = task, list(task.specs), time.monotonic()
        try:
            self.connection.send(task)
        except OSError:
            self._dead = True

    def read(self) -> Iterator[Said]:
        """What it says; nothing where it has ended."""
        try:
            said = self.connection.recv()
        except (EOFError, OSError):
            self._dead = True
            return
        if isinstance(said, Begun):
            self.since = time.monotonic()
            return
        if isinstance(said, Unit):
            self._left.remove(said.spec)
        if isinstance(said, Ended):
            self.task = None
        yield said

    def ended(self) -> str | None:
        """Why it has ended, None where it has not."""
        if not self._dead:
            return None
        self._process.join(_END)
        code = self._process.exitcode
        if code == -signal.SIGKILL:
            return "the process that judged it was killed, as Linux does where memory is short"
        if code is not None and code < 0:
            return f"the process that judged it was ended by {signal.Signals(-code).name}"
        return f"the process that judged it ended with {code}"

    def overdue(self, timeout: float | None) -> str | None:
        """That it takes too long, None where it does not."""
        if timeout is None or self.task is None or time.monotonic() < self.since + timeout:
            return None
        return f"took longer than {timeout:g} s (--timeout)"

    def end(self, why: str) -> tuple[Task | None, list[Said]]:
        """End it, and what is to be said of what it judged; and what is left of that for another one."""
        self.kill()
        task = self.task
        if task is None or not self._left:
            return None, [] if task is None else [Ended(task.place)]
        now, *rest = self._left
        told: list[Said] = [*failed(self._question, task, [now], f"{task.path}: {why}")]
        if not rest:
            return None, [*told, Ended(task.place)]
        return task._replace(specs=tuple(rest)), told

    def kill(self) -> None:
        self._process.kill()
        self._process.join(_END)
        self.connection.close()
        if self._folder is not None:
            self._folder.cleanup()


def _folder() -> TemporaryDirectory[str] | None:
    """Where a process unpacks, so that nothing of it is left when that is killed; None where there is no room."""
    try:
        return TemporaryDirectory(prefix="oracle-server-", ignore_cleanup_errors=True)
    except OSError:
        return None


def _work(question: Question, connection: Connection, folder: str | None) -> None:
    """The process: judges what it is given, until who gives it has ended; what it unpacks goes to a folder."""
    parent = multiprocessing.parent_process()
    assert parent is not None  # noqa: S101 -- it was started by one
    threading.Thread(target=_end_with, args=(parent.sentinel, folder), daemon=True).start()
    tempfile.tempdir = folder
    _be_modest()
    judge = Judge(question)
    while True:
        try:
            task: Task = connection.recv()
            told = _Told(connection, task)
            for said in judge.judge(task, told.show):
                told.units += isinstance(said, Unit)
                connection.send(said)
            connection.send(Ended(task.place))
            _tidy()
        except (EOFError, OSError):
            return


class _Told:
    """Says how far a recording is read, now and then."""

    def __init__(self, connection: Connection, task: Task) -> None:
        self._connection, self._task = connection, task
        self._next = time.monotonic() + _TOLD_EVERY
        self._events = 0
        self.units = 0
        """The specs that are through."""

    def show(self, part: float, events: int) -> None:
        now = time.monotonic()
        if now < self._next and part < 1:
            return
        self._next = now + _TOLD_EVERY
        of_all = (self.units + part) / len(self._task.specs)
        self._connection.send(Progress(self._task.place, of_all, max(0, events - self._events)))
        self._events = events if part < 1 else 0


def _be_modest() -> None:
    """Set up what is a process's own; where memory is short, Linux is to end this one, and not who waits for it."""
    import structlog

    from oracle_server.process.garbage import collect_rarely

    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))
    collect_rarely()
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")


def _tidy() -> None:
    """Let go of what recordings have left, which is not collected while one is judged."""
    if gc.get_freeze_count() > _MANY:
        gc.unfreeze()
        gc.collect()
        gc.freeze()


def _end_with(parent: int, folder: str | None) -> None:
    wait([parent])
    if folder is not None:
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)
