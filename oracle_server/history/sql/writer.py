"""Writes to a database: one thread, which commits all waiting rows together.

One statement inserts many rows, since the writer thread needs the interpreter for each statement, and may have to wait
until the event loop releases it. A disk that fails keeps all waiting; a row that the database refuses ends the history
of its own session, and of no other.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import structlog

from oracle_server.history.sql.batch import REFUSED, Refused, Then, Work, write, write_apart
from oracle_server.history.sql.blocks import BlockWriter
from oracle_server.history.sql.database import Database, Insert, Store
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.schema import STEP_COLUMNS

_Written = tuple[list[Work], list[Refused]]
_Way = Callable[[Database, list[Work], Insert], _Written]
MAX_PENDING = 20_000
"""Rows that may wait for their commit; beyond this limit, monitors are not read until there is room."""
_OF_ONE = 4_096
"""Characters of a step's signals that count as one row more: what is large takes long to write."""
_RETRY_AFTER = 1.0
"""Seconds until a failed commit is tried again."""
_NOBODY = 0
"""The number of no session."""
_GATHER = 0.01
"""Seconds for which rows are gathered before the writer is woken."""
PERIOD = 0.04
"""The least seconds between two commits: the writer competes with the event loop for the interpreter."""
_SIGNALS = STEP_COLUMNS.index("signals")

log = structlog.get_logger()


@dataclass(slots=True)
class _Batch:
    """The work that waits for the next commit, in order."""

    work: list[Work] = field(default_factory=list)
    size: int = 0


class Writer:
    """Queues rows and statements from the event loop's thread; each may have a callback for after its commit."""

    def __init__(self, store: Store) -> None:
        """Write with a connection, which nobody else uses and which this closes."""
        self._store = store
        self._loop: asyncio.AbstractEventLoop | None = None
        self._room = asyncio.Event()
        self._batch = _Batch()
        self._next: _Batch | None = None
        self._handing_over: asyncio.TimerHandle | None = None
        self._handed_over = 0.0
        self._wake = threading.Condition()
        self._stopping = False
        self._pending = 0
        self._uncommitted: deque[float] = deque()
        self._blocks = BlockWriter()
        self._thread = threading.Thread(target=self._run, name="history writer", daemon=True)
        self._failure: str | None = None
        self.failures: dict[int, str] = {}
        """Why nothing more is written of a session, by its number."""

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start the writer; callbacks run on `loop`."""
        self._loop = loop
        self._room.set()
        self._thread.start()

    @property
    def failure(self) -> str | None:
        """Why the history can't be written at present; None where it can."""
        return self._failure or self._store.overdue

    async def room(self) -> None:
        """Wait until no more than `MAX_PENDING` rows wait for their commit."""
        await self._room.wait()

    @property
    def has_room(self) -> bool:
        """Whether no more than `MAX_PENDING` rows wait for their commit."""
        return self._room.is_set()

    @property
    def pending(self) -> int:
        """The number of rows that wait for their commit."""
        return self._pending

    @property
    def lag(self) -> float:
        """Seconds for which the oldest row has waited for its commit."""
        return time.monotonic() - self._uncommitted[0] if self._uncommitted else 0.0

    def append(
        self,
        session: int,
        table: Literal["steps", "refused"],
        rows: Sequence[Row],
        done: Callable[[], object],
        then: Then | None = None,
    ) -> None:
        """Insert rows of a session with the next commit, and call `done` after it."""
        large = sum(len(row[_SIGNALS]) // _OF_ONE for row in rows) if table == "steps" else 0
        self.add(Work(session, table, rows, done, then=then), len(rows) + large + (0 if then is None else then.size))

    def add(self, work: Work, size: int = 1) -> None:
        """Do a piece of work with the next commit, after all earlier ones, and call its `done` after it.

        `done` is not called for what is refused.
        """
        if not self._batch.work:
            self._uncommitted.append(time.monotonic())
        self._batch.work.append(work)
        self._batch.size += size
        self._schedule()
        self._pending += size
        if self._pending > MAX_PENDING:
            self._room.clear()

    async def flush(self) -> None:
        """Wait until everything queued so far is committed, or refused."""
        committed = asyncio.Event()
        self.append(_NOBODY, "steps", [], committed.set)
        await committed.wait()

    def close(self) -> None:
        """Commit what waits, stop the writer and close the database. It blocks; don't call it on the event loop."""
        with self._wake:
            self._stopping = True
            self._wake.notify()
        if self._thread.is_alive():
            self._thread.join()
        self._store.close()

    def _schedule(self) -> None:
        if self._batch.work and self._handing_over is None and self._loop is not None:
            delay = max(_GATHER, self._handed_over + PERIOD - self._loop.time())
            self._handing_over = self._loop.call_later(delay, self._hand_over)

    def _hand_over(self) -> None:
        """Give the batch to the writer, unless the writer has not started the last one yet."""
        self._handing_over = None
        if not self._batch.work:
            return
        with self._wake:
            if self._next is None:
                self._next, self._batch = self._batch, _Batch()
                self._handed_over = self._loop.time() if self._loop else 0.0
                self._wake.notify()

    def _run(self) -> None:
        while True:
            with self._wake:
                due = True
                while self._next is None and not self._stopping and due:
                    due = self._wake.wait(self._store.renewal)
                batch, self._next = self._next, None
                stopping = self._stopping
                if batch is None and stopping and self._batch.work:
                    batch, self._batch = self._batch, _Batch()
            if batch is None and not stopping:
                self._attempt(self._store.renew)
            elif batch is None or not self._commit(batch):
                return  # a later batch without this one would leave a gap

    def _commit(self, batch: _Batch) -> bool:
        """Write a batch, with retries until the writer is closed; returns whether it is written."""
        found: list[_Written] = []
        while not self._attempt(lambda: found.append(self._write(batch))):
            with self._wake:
                if self._stopping:
                    return False
                self._wake.wait(_RETRY_AFTER)
        ((written, refused),) = found
        self._report(refused)
        assert self._loop is not None  # noqa: S101 -- the thread starts with the loop
        with contextlib.suppress(RuntimeError):  # the loop is closed, and with it those that wait
            self._loop.call_soon_threadsafe(self._committed, batch, written)
        return True

    def _attempt(self, work: Callable[[], object]) -> bool:
        """Do what needs the database, and note whether it can be written; returns whether it could."""
        try:
            work()
        except Exception as error:  # noqa: BLE001 -- without this thread, nothing would be written or reported
            known, self._failure = self._failure, self._store.reason(error)
            if known is None:
                log.error("the history can't be written", reason=self._failure, path=self._store.where)
            return False
        if self._failure is not None:
            self._failure = None
            log.info("the history can be written again")
        return True

    def _write(self, batch: _Batch) -> _Written:
        """Write a batch, apart from what is refused; returns what is written, and what is refused."""
        work = [one for one in batch.work if one.always or one.session not in self.failures]
        try:
            return self._transact(_write_together, work)
        except REFUSED:
            return self._transact(write_apart, work)

    def _transact(self, way: _Way, work: list[Work]) -> _Written:
        def transact(database: Database) -> _Written:
            written, refused = way(database, work, self._store.insert)
            self._blocks.follow(database, written)
            return written, refused

        try:
            return self._store.transact(transact)
        except BaseException:
            self._blocks.forget()
            raise

    def _report(self, refused: list[Refused]) -> None:
        """Note the sessions of which nothing more is written, and log what is refused."""
        for work, session, reason in refused:
            if not work.needed:
                log.error("the history refuses what can be done without", session=session, reason=reason)
            elif work.session not in self.failures:
                self.failures[work.session] = reason
                log.error("nothing more of a session can be kept", session=session, reason=reason)

    def _committed(self, batch: _Batch, written: list[Work]) -> None:
        self._uncommitted.popleft()
        self._schedule()
        self._pending -= batch.size
        if self._pending <= MAX_PENDING:
            self._room.set()
        assert self._loop is not None  # noqa: S101 -- it calls this
        for work in written:
            if work.done is not None:
                self._loop.call_soon(work.done)  # where one fails, the others are called all the same


def _write_together(database: Database, work: list[Work], insert: Insert) -> _Written:
    write(database, work, insert)
    return work, []
