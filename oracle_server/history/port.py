"""What a history must do, whatever keeps it.

Commands are given on the event loop's thread, return at once, and are done in the order in which they were given.
`done` is called on that thread once a command is committed: from then on every query finds what it wrote, and it
outlives the process where the backend keeps anything that long. Queries are awaited, never block the event loop, and
see what is committed. They raise `HistoryError` where the history can't be read.

A value that can't be kept, now or ever, ends the history of its own session alone, before what it is part of: nothing
later of it is kept but how it was closed, and no `done` of that is called. No command raises for it.

Sessions are named by their number, steps by their position (1, 2, 3… in each session). Times are integer nanoseconds.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Collection, Mapping, Sequence
from typing import Protocol, TypeVar

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.revisions import Revision
from oracle_server.history.episodes import EpisodeQuery, Page, StoredEpisode
from oracle_server.history.matching import Told
from oracle_server.history.query import Query
from oracle_server.history.records import (
    Document,
    Elsewhere,
    Extent,
    MonitorRecord,
    OtherSession,
    Refusal,
    SessionRecord,
    SnapshotRecord,
    StoredStep,
)
from oracle_server.history.timeline import Question
from oracle_server.history.views import Doubts
from oracle_server.history.whose import ALL, Whose

T = TypeVar("T")
Done = Callable[[], object]
DELETED = "a part of the session was deleted before it was read, as retention does: ask again for what is kept"
"""What is said of a read that can't be whole any more."""


class Writing(Protocol):
    """Commands, and how the writing goes."""

    @property
    def failure(self) -> str | None:
        """Why nothing can be written at the moment, None where it can."""
        ...

    @property
    def read_only(self) -> str | None:
        """Why nothing is kept by this server, which only reads; None where it keeps what it judges."""
        ...

    def failure_of(self, session: int) -> str | None:
        """Why nothing more of a session can be kept, None where it can."""
        ...

    @property
    def has_room(self) -> bool:
        """Whether more may be given; else monitors are not read until there is room."""
        ...

    @property
    def pending(self) -> int:
        """Rows that were given and are not committed yet."""
        ...

    @property
    def lag(self) -> float:
        """Seconds for which the oldest of them has waited."""
        ...

    async def room(self) -> None:
        """Wait until there is room."""
        ...

    async def flush(self) -> None:
        """Wait until all that was given is committed or can't be kept: without an end while nothing can be written."""
        ...

    def open_session(self, session: SessionRecord) -> None:
        """Keep a new session; its number and id are no other's."""
        ...

    def begin_session(self, session: int, at: int) -> None:
        """Keep when a session began (ns), which was not kept with it."""
        ...

    def close_session(self, session: int, at: int, state: Document, done: Done | None = None) -> None:
        """Keep that a session was closed, and how it stood then, also where nothing else of it can be kept.

        No episode of it is open any more.
        """
        ...

    def set_monitor(self, session: int, monitor: MonitorRecord, done: Done | None = None) -> None:
        """Keep a monitor of a session, in place of the one of that name."""
        ...

    def append(
        self, session: int, steps: Sequence[StoredStep], done: Done, revisions: Sequence[Revision] = (),
        episodes: Sequence[StoredEpisode] = (),
    ) -> None:  # fmt: skip
        """Keep steps that were judged, and revisions; their positions follow the last one's.

        Episodes that they open, join or end are kept with them, in place of what is kept of these. What stands since
        the revisions of steps is kept with them, as far as they are not deleted. All of one call is committed at once,
        or nothing of it.
        """
        ...

    def stop(self, session: int, reason: str) -> None:
        """Keep nothing of a session from here on but that it was closed, for a reason, since a step of it is lost."""
        ...

    def trouble(self, session: int, why: str | None) -> None:
        """Keep why an open session is not judged any more, or that it is, for those who read it elsewhere."""
        ...

    def refuse(self, session: int, refusal: Refusal, done: Done) -> None:
        """Keep that an event was refused."""
        ...

    def amend(self, session: int, monitor: str, seq: int, handling: tuple[bool, str], done: Done) -> None:
        """Add to the step at which an event was decided whether the adapter let it pass, and why.

        Where it is judged by two orders its step in the other one decided nothing.
        """
        ...

    def save_snapshot(self, session: int, snapshot: SnapshotRecord) -> None:
        """Keep a snapshot in place of the last one, which stays if it can't. Its data is read before this returns."""
        ...

    async def forget_steps(self, session: int, before: int) -> None:
        """Delete a session's steps before a position, and episodes that ended before; return once that is committed."""
        ...

    async def forget_refused(self, session: int, keep: int) -> int:
        """Delete a session's refused events but the last `keep`, and those that its next start needs.

        Return, once that is committed, how many are kept beyond `keep` because they are needed: by their numbers no
        snapshot has them.
        """
        ...

    async def forget_session(self, session: int) -> None:
        """Delete a session and all that is left of it; return once that is committed."""
        ...


class Reading(Protocol):
    """Queries."""

    async def in_thread(self, work: Callable[[], T]) -> T:
        """Work at what was read for some milliseconds, in one of the threads that read: clients take turns there."""
        ...

    async def missing(self, session: SessionRecord) -> Sequence[tuple[int, int]]:
        """The first and last positions of the steps that a robot had deleted before it brought them."""
        ...

    async def last_number(self) -> int:
        """The largest number of a session, 0 where there is none."""
        ...

    async def last_time(self) -> int:
        """The latest time at which something was judged, 0 where nothing was."""
        ...

    async def open_sessions(self) -> list[SessionRecord]:
        """The sessions of this server that are not closed, by number."""
        ...

    async def session(self, name: str | int) -> SessionRecord | None:
        """A session by its id or number, open or closed."""
        ...

    async def names(self, beginning: str) -> list[str]:
        """The ids of all sessions, open or closed, that begin with a text."""
        ...

    async def closed_state(self, name: str) -> Document | None:
        """How a closed session stood, None where none of that id is closed."""
        ...

    async def closed_states(self, limit: int, whose: Whose = ALL) -> list[Document]:
        """How the sessions stood that were opened last and are closed, of those that are asked of, the newest first."""
        ...

    async def monitors(self, session: int) -> list[MonitorRecord]:
        """The monitors of a session."""
        ...

    async def refusals(self, session: int, after: Mapping[str, int] | None = None) -> list[Refusal]:
        """The refused events of a session; with `after` of these monitors only, those behind a number of each."""
        ...

    async def refused(self, session: int) -> int:
        """How many events of a session were refused."""
        ...

    async def snapshot(self, session: int) -> SnapshotRecord | None:
        """The snapshot of a session; its data is None where it can't be decoded."""
        ...

    async def extent(self, session: int) -> tuple[int, int]:
        """The first and the last position of a session's steps; (1, 0) where there are none."""
        ...

    async def step(self, session: int, position: int) -> StoredStep | None:
        """The step at a position."""
        ...

    async def asked_step(self, session: int, monitor: str, seq: int) -> StoredStep | None:
        """The step of an event at which it was decided."""
        ...

    def steps(self, session: int, after: int, upto: int | None = None) -> AsyncGenerator[list[StoredStep], None]:
        """The steps behind a position, up to another, by pages in their sequence."""
        ...

    def by_arrival(self, session: int) -> AsyncGenerator[list[StoredStep], None]:
        """All steps by pages: by arrival, monitor, sequence number and position; no revisions.

        Raises `HistoryError` where one of them is deleted before it is read.
        The memory needed does not grow. Nothing is kept open between two pages that a writer would wait for.
        """
        ...

    async def told(self, session: SessionRecord, query: Query, position: int, doubts: Doubts | None = None) -> Told:
        """The verdict records that a query asks for, from a position on, and one more than its limit where there is.

        So many positions are looked at for them at the most, where it disturbs no decision: `find` asks on.
        """
        ...

    async def episodes(self, query: EpisodeQuery) -> Page:
        """A page of the episodes that a query asks for."""
        ...

    async def timeline(self, session: SessionRecord, question: Question) -> bytes:
        """What a session tells by time, as JSON, made where it disturbs no decision. Raises `UnpreparedError`."""
        ...

    async def first_final(self, session: int, order: Order, index: int, upto: int) -> int | None:
        """The position of the first step at which a property (by index) is `true` or `false` for good, None if none."""
        ...

    async def last_counted(self, session: int, order: Order, upto: int, undoing: Sequence[StreamKey]) -> int | None:
        """The position of the last step that later ones build on: no tick, not skipped, no denied attempt.

        A denied event of the streams `undoing` counts for itself alone.
        """
        ...

    async def extents(self) -> list[Extent]:
        """What is kept of each session, by number."""
        ...

    async def judged_before(self, extent: Extent, time: int) -> int:
        """How many of a session's steps were judged before a time."""
        ...

    async def size(self) -> int:
        """Bytes that the history takes."""
        ...


class Sharing(Protocol):
    """What there is to say where several servers have one history. Each session that is open has one of them."""

    @property
    def others(self) -> bool:
        """Whether other servers were there lately."""
        ...

    @property
    def adrift(self) -> bool:
        """Whether another server may have this one's sessions by now: nobody may be told anything more of them here."""
        ...

    @property
    def fenced(self) -> str | None:
        """Why nothing more can be kept by this server, ever; None where it can."""
        ...

    async def reserve(self, name: str, number: int) -> int | None:
        """Take a name for a new session: returns its number, and None where another server has taken the name.

        It is `number` where one server numbers all sessions. Raises `HistoryError` where that can't be known now.
        """
        ...

    async def elsewhere(self, name: str) -> Elsewhere | None:
        """Who has a session that is open, by its id; None where it is closed, unknown, or nobody else can have it."""
        ...

    async def open_elsewhere(self, name: str | None = None, origin: str | None = None) -> list[OtherSession]:
        """The sessions that other servers have open, the newest first; or the open one of a name, whoever has it.

        With `origin` those that are forwarded from this robot. What they tell of properties is that of the order that
        decides.
        """
        ...

    async def left(self) -> list[str]:
        """The names of open sessions of which nothing more will come: their robots have deleted them."""
        ...

    async def take_over(self, known: Collection[int]) -> list[SessionRecord]:
        """Take the sessions of servers whose lease has run out; returns those that are this one's, and not `known`."""
        ...

    async def tended(self) -> frozenset[int] | None:
        """The numbers of the sessions of which this server may delete, None for all."""
        ...


class History(Writing, Reading, Sharing, Protocol):
    """A history."""

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin to write; `done` is called on `loop`."""
        ...

    async def catch_up(self) -> None:
        """Make what this version keeps, and older ones that have written did not; return once all of it is there."""
        ...

    def close(self) -> None:
        """Commit what waits, and let go of everything. To be called off the event loop, once."""
        ...
