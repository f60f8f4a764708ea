"""The history in a database: commands are statements for the writer, queries have connections of their own."""

from __future__ import annotations

import asyncio
import contextlib
from bisect import bisect_left
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from itertools import chain
from typing import ClassVar, TypeVar

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Outcome
from oracle_server.history.episodes import EpisodeQuery, Page, StoredEpisode
from oracle_server.history.letters import LETTERS
from oracle_server.history.matching import Told
from oracle_server.history.port import Done
from oracle_server.history.query import Query
from oracle_server.history.readers import Readers
from oracle_server.history.records import (
    Document,
    Extent,
    MonitorRecord,
    Refusal,
    SessionRecord,
    SnapshotRecord,
    StoredStep,
)
from oracle_server.history.sql import troubles
from oracle_server.history.sql.asking import Asking
from oracle_server.history.sql.batch import OF_ONE, REFUSED, Work, restating
from oracle_server.history.sql.blocks import forgetting
from oracle_server.history.sql.catching import catch_up
from oracle_server.history.sql.database import Database, Store
from oracle_server.history.sql.episodes import COUNT, END, FORGET, keeping, read
from oracle_server.history.sql.reader import FIRST_PAGE, Reader, following
from oracle_server.history.sql.refusals import needless, refusals
from oracle_server.history.sql.rows import (
    Row,
    document_of,
    monitor_of,
    monitor_row,
    session_of,
    session_row,
    snapshot_of,
    snapshot_row,
    step_of,
    step_row,
    text,
)
from oracle_server.history.sql.schema import MONITOR_COLUMNS, SESSION_COLUMNS, STEP_COLUMNS
from oracle_server.history.sql.statements import (
    AMEND,
    ASKED,
    EXTENT,
    FORGET_SESSION,
    KEPT,
    LAST_TIME,
    OPEN,
    SESSIONS,
    SIZE,
    STEPS,
    UPTO,
    insertion,
    upsert,
)
from oracle_server.history.sql.whose import closed
from oracle_server.history.sql.writer import Writer
from oracle_server.history.timeline import Question
from oracle_server.history.views import Doubts
from oracle_server.history.whose import ALL, Whose

T = TypeVar("T")

_PAGE = 1_000
LOOKUPS = 4
"""Threads for what decisions and monitors wait for, one row each: those that read pages are taken by long queries."""
_LAST = 2**62
"""A position behind every step."""
_SNAPSHOT = ("session", "position", "data", "settled", "numbers")
_FINAL = LETTERS[Outcome.TRUE], LETTERS[Outcome.FALSE]


class SqlHistory:
    """A `History` in a database, of which a backend gives the connections."""

    _forgetting: ClassVar[Sequence[str]] = FORGET_SESSION

    def __init__(self, store: Store, reader: Callable[[Readers, Readers], Reader], asking: Asking) -> None:
        """Write with a connection; read with `reader` in some threads, in others what is to be put in order."""
        self._writer = Writer(store)
        self._readers, self._sorters = Readers(), Readers(name="history sorting")
        self._reader = reader(self._readers, self._sorters)
        self._asking = asking
        self._lookup_threads = Readers(LOOKUPS, LOOKUPS, "history lookup")
        self._lookups = reader(self._lookup_threads, self._lookup_threads)

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin to write; callbacks run on `loop`."""
        self._writer.start(loop)

    def close(self) -> None:
        """Commit what waits and close the database. Call it off the event loop."""
        self._writer.close()
        self._asking.close()
        self._lookup_threads.close()
        self._sorters.close()
        self._readers.close()

    async def catch_up(self) -> None:
        """Make the blocks of what older versions have written."""
        await catch_up(self._reader, self._writer)

    # how the writing goes

    @property
    def failure(self) -> str | None:
        """Why nothing can be written at the moment."""
        return self._writer.failure

    @property
    def read_only(self) -> str | None:
        """Why nothing is kept: all is."""
        return None

    def failure_of(self, session: int) -> str | None:
        """Why nothing more is written of a session."""
        return self._writer.failures.get(session)

    @property
    def has_room(self) -> bool:
        """Whether more may be given."""
        return self._writer.has_room

    @property
    def pending(self) -> int:
        """Rows that wait for the disk."""
        return self._writer.pending

    @property
    def lag(self) -> float:
        """Seconds for which the oldest row has waited for its commit."""
        return self._writer.lag

    async def room(self) -> None:
        """Wait until there is room."""
        await self._writer.room()

    async def flush(self) -> None:
        """Wait until all that was given is committed, or refused."""
        await self._writer.flush()

    # commands

    def open_session(self, session: SessionRecord) -> None:
        """Keep a new session."""
        self._execute(session.number, insertion("sessions", SESSION_COLUMNS), lambda: session_row(session))

    def begin_session(self, session: int, at: int) -> None:
        """Keep when a session began."""
        self._execute(session, "UPDATE sessions SET begun = ? WHERE number = ?", lambda: (at, session))

    def close_session(self, session: int, at: int, state: Document, done: Done | None = None) -> None:
        """Keep that a session was closed."""
        self._execute(session, END, lambda: (session,), needed=False, always=True)
        sql = "UPDATE sessions SET closed = ?, state = ? WHERE number = ?"
        self._execute(session, sql, lambda: (at, text(state), session), done, needed=False, always=True)

    def set_monitor(self, session: int, monitor: MonitorRecord, done: Done | None = None) -> None:
        """Keep a monitor of a session."""
        sql = upsert("monitors", MONITOR_COLUMNS, MONITOR_COLUMNS[:2])
        self._execute(session, sql, lambda: monitor_row(session, monitor), done)

    def append(
        self, session: int, steps: Sequence[StoredStep], done: Done, revisions: Sequence[Revision] = (),
        episodes: Sequence[StoredEpisode] = (),
    ) -> None:  # fmt: skip
        """Keep steps that were judged, what stands of earlier ones, and episodes."""
        try:
            rows = [step_row(session, step) for step in steps]
            kept = keeping(session, episodes) if episodes else ()
            then = restating(session, revisions) if revisions else None
        except REFUSED as error:
            self._writer.add(Work(session, error, ()))
        else:
            if rows or not kept:
                self._writer.append(session, "steps", rows, done, then)
            for i, (sql, values) in enumerate(kept, 1):  # in the same commit, as nothing is awaited
                last = done if not rows and i == len(kept) else None
                self._writer.add(Work(session, sql, values, last), 1 + len(episodes) // OF_ONE)

    def stop(self, session: int, reason: str) -> None:
        """Keep nothing of a session from here on."""
        self._writer.add(Work(session, ValueError(reason), ()))

    def trouble(self, session: int, why: str | None) -> None:
        """Keep why an open session is not judged any more, or that it is."""
        self._execute(session, troubles.NOTE, lambda: troubles.note(session, why), needed=False, always=True)

    def refuse(self, session: int, refusal: Refusal, done: Done) -> None:
        """Keep that an event was refused."""
        self._writer.append(session, "refused", [(session, *refusal)], done)

    def amend(self, session: int, monitor: str, seq: int, handling: tuple[bool, str], done: Done) -> None:
        """Add to the step at which an event was decided what the adapter did."""
        self._execute(session, AMEND, lambda: (*handling, session, monitor, seq), done)

    def save_snapshot(self, session: int, snapshot: SnapshotRecord) -> None:
        """Keep a snapshot in place of the last one."""
        sql = upsert("snapshots", _SNAPSHOT, _SNAPSHOT[:1])
        self._execute(session, sql, lambda: snapshot_row(session, snapshot), needed=False)

    async def forget_steps(self, session: int, before: int) -> None:
        """Delete a session's steps before a position."""
        for sql in (COUNT, FORGET):
            self._execute(session, sql, lambda: (session, before), needed=False, always=True)
        for sql, values in forgetting(session, before):
            self._writer.add(Work(session, sql, values, always=True))
        await self._do(session, "DELETE FROM steps WHERE session = ? AND position < ?", (session, before))

    async def forget_refused(self, session: int, keep: int) -> int:
        """Delete a session's refused events but the last ones, and those that its next start needs."""
        saved = await self.snapshot(session)
        found = await self._reader.run(lambda reader: needless(reader, session, saved, keep))
        for statement in found.statements:
            await self._do(session, *statement)
        return found.needed

    async def forget_session(self, session: int) -> None:
        """Delete all that is left of a session."""
        *statements, last = self._forgetting
        for sql in statements:  # in one commit, as nothing is awaited
            self._execute(session, sql, lambda: (session,), needed=False, always=True)
        await self._do(session, last, (session,))

    async def _do(self, session: int, sql: str, values: Row) -> None:
        done = asyncio.Event()
        self._writer.add(Work(session, sql, values, done.set, always=True))
        await done.wait()

    def _execute(
        self, session: int, sql: str, make: Callable[[], Row], done: Done | None = None,
        *, needed: bool = True, always: bool = False,
    ) -> None:  # fmt: skip
        """Execute a statement with values that are made now, or refused with what else is."""
        what: str | Exception = sql
        values: Row = ()
        try:
            values = make()
        except REFUSED as error:
            what = error
        self._writer.add(Work(session, what, values, done, needed, always))

    # queries

    async def in_thread(self, work: Callable[[], T]) -> T:
        """Work at what was read, in one of the threads that read."""
        return await self._readers.start(work)

    async def last_number(self) -> int:
        """The largest number of a session."""
        (number,) = await self._reader.row("SELECT coalesce(max(number), 0) FROM sessions")
        return int(number)

    async def last_time(self) -> int:
        """The latest time at which something was judged."""
        (time,) = await self._reader.row(LAST_TIME)
        return int(time)

    async def open_sessions(self) -> list[SessionRecord]:
        """The sessions that are not closed, but those that robots forward."""
        return await self._reader.sound(session_of, OPEN)

    async def session(self, name: str | int) -> SessionRecord | None:
        """A session by its id or number."""
        key = "id" if isinstance(name, str) else "number"
        return await self._lookups.one(session_of, f"{SESSIONS} WHERE {key} = ?", (name,))

    async def names(self, beginning: str) -> list[str]:
        """The ids of sessions that begin with a text."""
        sql = "SELECT id FROM sessions WHERE id >= ? AND id < ?"  # an index has these; behind `~` no id goes on
        return await self._lookups.all(lambda row: str(row[0]), sql, (beginning, f"{beginning}~"))

    async def closed_state(self, name: str) -> Document | None:
        """How a closed session stood."""
        sql = "SELECT state, id FROM sessions WHERE id = ? AND closed IS NOT NULL"
        return await self._lookups.one(document_of, sql, (name,))

    async def closed_states(self, limit: int, whose: Whose = ALL) -> list[Document]:
        """How the closed sessions stood of which it is asked, the newest first."""
        return await self._reader.sound(document_of, *closed(whose, limit))

    async def monitors(self, session: int) -> list[MonitorRecord]:
        """The monitors of a session."""
        sql = f"SELECT {','.join(MONITOR_COLUMNS)} FROM monitors WHERE session = ?"  # noqa: S608
        return await self._reader.all(monitor_of, sql, (session,))

    async def refusals(self, session: int, after: Mapping[str, int] | None = None) -> list[Refusal]:
        """The refused events of a session, or of some monitors behind a number of each."""
        return await self._reader.run(lambda reader: refusals(reader, session, after))

    async def refused(self, session: int) -> int:
        """How many events of a session were refused."""
        (count,) = await self._reader.row("SELECT count(*) FROM refused WHERE session = ?", (session,))
        return int(count)

    async def snapshot(self, session: int) -> SnapshotRecord | None:
        """The snapshot of a session."""
        sql = "SELECT position, data, settled, numbers FROM snapshots WHERE session = ?"
        return await self._reader.one(snapshot_of, sql, (session,))

    async def extent(self, session: int) -> tuple[int, int]:
        """The first and the last position of a session's steps."""
        first, last = await self._reader.row(EXTENT, (session,))
        return first, last

    async def step(self, session: int, position: int) -> StoredStep | None:
        """The step at a position."""
        return await self._reader.one(step_of, f"{STEPS} WHERE session = ? AND position = ?", (session, position))

    async def asked_step(self, session: int, monitor: str, seq: int) -> StoredStep | None:
        """The step of an event at which it was decided."""
        return await self._lookups.one(step_of, ASKED, (session, monitor, seq))

    async def steps(self, session: int, after: int, upto: int | None = None) -> AsyncGenerator[list[StoredStep], None]:
        """The steps behind a position, up to another, by pages."""
        sql = f"{STEPS} WHERE session = ? AND position > ? AND position <= ? ORDER BY position LIMIT ?"
        last, size = _LAST if upto is None else upto, FIRST_PAGE
        while page := await self._reader.some(step_of, sql, (session, after, last, size)):
            yield page
            after, size = page[-1].position, following(size, len(page), _PAGE)

    async def by_arrival(self, session: int) -> AsyncGenerator[list[StoredStep], None]:
        """All steps by pages, by arrival."""
        where = "session = ? AND revision IS NULL"
        keys = f"SELECT session, position FROM steps WHERE {where} ORDER BY arrived, monitor, seq, position"  # noqa: S608
        columns = ",".join(f"steps.{name}" for name in STEP_COLUMNS)
        page = (
            f"SELECT {columns}, sorted.rowid FROM sorted JOIN steps USING (session, position) "  # noqa: S608
            "WHERE session = ? AND sorted.rowid BETWEEN ? AND ? ORDER BY sorted.rowid"
        )
        async with contextlib.aclosing(self._reader.pages(step_of, keys, page, (session,), _PAGE)) as pages:
            async for steps in pages:
                yield steps

    async def told(self, session: SessionRecord, query: Query, position: int, doubts: Doubts | None = None) -> Told:
        """The verdict records that a query asks for, from a position on."""
        return await self._asking.told(session, query, position, doubts)

    async def episodes(self, query: EpisodeQuery) -> Page:
        """A page of the episodes that a query asks for."""
        return await self._reader.run(lambda reader: read(reader, query))

    async def timeline(self, session: SessionRecord, question: Question) -> bytes:
        """What a session tells by time, as JSON."""
        return await self._asking.timeline(session, question)

    async def first_final(self, session: int, order: Order, index: int, upto: int) -> int | None:
        """The position of the first step at which a property is final."""
        sql = f"SELECT min(position) FROM steps WHERE {UPTO} AND substr(outcomes, ?, 1) IN (?, ?)"  # noqa: S608
        (position,) = await self._reader.row(sql, (session, upto, order, index + 1, *_FINAL))
        return None if position is None else int(position)

    async def last_counted(self, session: int, order: Order, upto: int, undoing: Sequence[StreamKey]) -> int | None:
        """The position of the last step that later ones build on."""
        undone = (
            f"coalesce(decision, '') = 'deny' AND (stream, kind) IN (VALUES {','.join(['(?,?)'] * len(undoing))})"
            if undoing
            else "false"
        )
        sql = f"SELECT max(position) FROM steps WHERE {UPTO} AND number > 0 AND NOT ({undone})"  # noqa: S608
        (position,) = await self._reader.row(sql, (session, upto, order, *chain.from_iterable(undoing)))
        return None if position is None else int(position)

    async def extents(self) -> list[Extent]:
        """What is kept of each session."""
        return await self._reader.run(
            lambda reader: [
                Extent(*row[:4], *reader.execute(EXTENT, row[:1]).fetchone(), *row[4:])
                for row in reader.execute(KEPT).fetchall()
            ]
        )

    async def judged_before(self, extent: Extent, time: int) -> int:
        """How many of a session's steps were judged before a time."""
        sql = "SELECT judged FROM steps WHERE session = ? AND position >= ? ORDER BY position LIMIT 1"  # some may lack
        positions = range(extent.first, extent.last + 1)

        def search(reader: Database) -> int:
            return bisect_left(positions, time, key=lambda p: reader.execute(sql, (extent.number, p)).fetchone()[0])

        return await self._reader.run(search)

    async def size(self) -> int:
        """Bytes that the history takes."""
        (size,) = await self._reader.row(SIZE)
        return int(size)
