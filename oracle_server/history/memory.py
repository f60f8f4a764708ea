"""A history that ends with its process: for tests, and for trials that leave nothing behind."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import msgspec
import structlog

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import FINAL
from oracle_server.history.alone import Alone
from oracle_server.history.episodes import EpisodeQuery, Page, StoredEpisode, page_of
from oracle_server.history.matching import Take, Told, told
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
    restated,
)
from oracle_server.history.remembered import STEP, Kept
from oracle_server.history.steps import StepsSource, arrival, is_undone, made, plain, without_data
from oracle_server.history.timeline import Question, answer
from oracle_server.history.views import Doubts
from oracle_server.history.whose import ALL, Whose

T = TypeVar("T")
_encode = msgspec.json.Encoder().encode

_PAGE = 1_000
_NOBODY = 0
"""The number of no session."""
_FORGOTTEN = SessionRecord(0, "", "", "", "", (), private=False, opened=0)

log = structlog.get_logger()


@dataclass(slots=True)
class _Command:
    """Work for a session. Where it fails, no later one of it is done, unless this one is not `needed` for that."""

    session: int
    work: Callable[[], object]
    done: Done | None = None
    needed: bool = True
    always: bool = False


class MemoryHistory(Alone):
    """A `History` that is lost when the process ends: what is given is committed with the loop's next turn."""

    failure: str | None = None
    has_room = True
    lag = 0.0

    def __init__(self) -> None:
        """Keep nothing yet."""
        self._kept: dict[int, Kept] = {}
        self._failures: dict[int, str] = {}
        self._given: list[_Command] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._readers = Readers()

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin to write; callbacks run on `loop`."""
        self._loop = loop
        loop.call_soon(self._commit)

    async def catch_up(self) -> None:
        """No older version has written to it."""

    def close(self) -> None:
        """End the threads; what is kept ends with the process."""
        self._readers.close()

    def failure_of(self, session: int) -> str | None:
        """Why nothing more of a session can be kept."""
        return self._failures.get(session)

    @property
    def pending(self) -> int:
        """Commands that wait for the loop's next turn."""
        return len(self._given)

    async def room(self) -> None:
        """There always is room."""

    async def flush(self) -> None:
        """Wait until all that was given is committed, or can't be kept."""
        await self._done(_NOBODY, lambda: None)

    # commands

    def open_session(self, session: SessionRecord) -> None:
        """Keep a new session."""
        self._do(_Command(session.number, lambda: self._kept.update({session.number: Kept(session)})))

    def begin_session(self, session: int, at: int) -> None:
        """Keep when a session began."""

        def begin() -> None:
            kept = self._of(session)
            kept.record = kept.record._replace(begun=at)

        self._do(_Command(session, begin))

    def close_session(self, session: int, at: int, state: Document, done: Done | None = None) -> None:
        """Keep that a session was closed."""
        document = made(lambda: plain(state))

        def close() -> None:
            kept = self._of(session)
            kept.episodes.end()
            kept.state, kept.closed = document(), at

        self._do(_Command(session, close, done, needed=False, always=True))

    def set_monitor(self, session: int, monitor: MonitorRecord, done: Done | None = None) -> None:
        """Keep a monitor of a session."""
        self._do(_Command(session, lambda: self._of(session).monitors.update({monitor.name: monitor}), done))

    def append(
        self, session: int, steps: Sequence[StoredStep], done: Done, revisions: Sequence[Revision] = (),
        episodes: Sequence[StoredEpisode] = (),
    ) -> None:  # fmt: skip
        """Keep steps that were judged, without their data, what stands of earlier ones, and episodes."""
        kept = made(lambda: [without_data(step) for step in steps])
        standing = restated(revisions)

        def extend() -> None:
            of = self._of(session)
            of.steps.extend(kept())
            for position, stands in standing.items():
                of.restate(position, stands)
            of.episodes.keep(episodes)

        self._do(_Command(session, extend, done))

    def stop(self, session: int, reason: str) -> None:
        """Keep nothing of a session from here on."""
        self._do(_Command(session, lambda: self._failures.setdefault(session, reason)))

    def trouble(self, session: int, why: str | None) -> None:
        """Nobody reads it elsewhere."""

    def refuse(self, session: int, refusal: Refusal, done: Done) -> None:
        """Keep that an event was refused."""
        self._do(_Command(session, lambda: self._of(session).refusals.append(refusal), done))

    def amend(self, session: int, monitor: str, seq: int, handling: tuple[bool, str], done: Done) -> None:
        """Add to the step at which an event was decided what the adapter did."""

        def amend() -> None:
            steps = self._of(session).steps
            passed, why = handling
            for i, step in enumerate(steps):
                event = step.step.event
                if (event.monitor, event.seq) == (monitor, seq) and (step.decision or not event.ask):
                    steps[i] = msgspec.structs.replace(step, passed=passed, why=why)

        self._do(_Command(session, amend, done))

    def save_snapshot(self, session: int, snapshot: SnapshotRecord) -> None:
        """Keep a snapshot in place of the last one."""
        kept = made(lambda: snapshot._replace(data=plain(snapshot.data), numbers=plain(snapshot.numbers)))

        def save() -> None:
            self._of(session).snapshot = kept()

        self._do(_Command(session, save, needed=False))

    async def forget_steps(self, session: int, before: int) -> None:
        """Delete a session's steps before a position."""

        def forget() -> None:
            kept = self._of(session)
            del kept.steps[: kept.index(before)]
            kept.episodes.forget((before - 1) * len(kept.record.properties))

        await self._done(session, forget)

    async def forget_refused(self, session: int, keep: int) -> int:
        """Delete a session's refused events but the last ones, and those that its next start needs."""
        needed: list[int] = []
        await self._done(session, lambda: needed.append(self._of(session).forget_refused(keep)))
        return needed[0]

    async def forget_session(self, session: int) -> None:
        """Delete all that is left of a session."""
        await self._done(session, lambda: self._kept.pop(session, None))

    def _do(self, command: _Command) -> None:
        self._given.append(command)
        if self._loop is not None and len(self._given) == 1:
            self._loop.call_soon(self._commit)

    async def _done(self, session: int, work: Callable[[], object]) -> None:
        committed = asyncio.Event()
        self._do(_Command(session, work, committed.set, always=True))
        await committed.wait()

    def _commit(self) -> None:
        given, self._given = self._given, []
        assert self._loop is not None  # noqa: S101 -- it calls this
        for done in [command.done for command in given if self._carry_out(command)]:
            if done is not None:
                self._loop.call_soon(done)  # where one fails, the others are called all the same

    def _carry_out(self, command: _Command) -> bool:
        """Do the work of a command unless nothing more of its session can be kept; returns whether it is done."""
        if command.session in self._failures and not command.always:
            return False
        try:
            command.work()
        except Exception as error:  # noqa: BLE001 -- whatever it is, the others' work is done
            log.error("something of a session can't be kept", session=command.session, reason=str(error))
            if command.needed:
                self._failures[command.session] = str(error)
            return False
        return True

    # queries

    async def in_thread(self, work: Callable[[], T]) -> T:
        """Work at what was read, in one of the threads that read."""
        return await self._readers.start(work)

    async def last_number(self) -> int:
        """The largest number of a session."""
        return max(self._kept, default=0)

    async def last_time(self) -> int:
        """The latest time at which something was judged."""
        robots = [kept for kept in self._kept.values() if kept.record.kind == "robot"]
        return max((step.judged for kept in robots for step in kept.steps), default=0)

    async def open_sessions(self) -> list[SessionRecord]:
        """The sessions that are not closed."""
        return [kept.record for _, kept in sorted(self._kept.items()) if kept.closed is None]

    async def session(self, name: str | int) -> SessionRecord | None:
        """A session by its id or number."""
        return next((kept.record for kept in self._kept.values() if name in (kept.record.id, kept.record.number)), None)

    async def names(self, beginning: str) -> list[str]:
        """The ids of sessions that begin with a text."""
        return [kept.record.id for kept in self._kept.values() if kept.record.id.startswith(beginning)]

    async def closed_state(self, name: str) -> Document | None:
        """How a closed session stood."""
        return next((kept.state for kept in self._kept.values() if kept.record.id == name), None)

    async def closed_states(self, limit: int, whose: Whose = ALL) -> list[Document]:
        """How the closed sessions stood of which it is asked, the newest first."""
        kept = [self._kept[number] for number in sorted(self._kept, reverse=True)]
        asked = [one for one in kept if whose.has(one.record)]
        return [one.state for one in asked if one.state is not None][:limit]

    async def monitors(self, session: int) -> list[MonitorRecord]:
        """The monitors of a session."""
        return list(self._of(session).monitors.values())

    async def refusals(self, session: int, after: Mapping[str, int] | None = None) -> list[Refusal]:
        """The refused events of a session, or of some monitors behind a number of each."""
        kept = self._of(session).refusals
        return [r for r in kept if after is None or (r.monitor in after and r.seq > after[r.monitor])]

    async def refused(self, session: int) -> int:
        """How many events of a session were refused."""
        return len(self._of(session).refusals)

    async def snapshot(self, session: int) -> SnapshotRecord | None:
        """The snapshot of a session."""
        return self._of(session).snapshot

    async def extent(self, session: int) -> tuple[int, int]:
        """The first and the last position of a session's steps."""
        steps = self._steps(session)
        return (steps[0].position, steps[-1].position) if steps else (1, 0)

    async def step(self, session: int, position: int) -> StoredStep | None:
        """The step at a position."""
        return next((step for step in self._steps(session) if step.position == position), None)

    async def asked_step(self, session: int, monitor: str, seq: int) -> StoredStep | None:
        """The step of an event at which it was decided."""
        return next(
            (
                step
                for step in self._steps(session)
                if step.decision is not None and (step.step.event.monitor, step.step.event.seq) == (monitor, seq)
            ),
            None,
        )

    async def steps(self, session: int, after: int, upto: int | None = None) -> AsyncGenerator[list[StoredStep], None]:
        """The steps behind a position, up to another, by pages."""
        found = [s for s in self._steps(session) if s.position > after and (upto is None or s.position <= upto)]
        for start in range(0, len(found), _PAGE):
            yield found[start : start + _PAGE]

    async def by_arrival(self, session: int) -> AsyncGenerator[list[StoredStep], None]:
        """All steps by pages, by arrival."""
        found = sorted((s for s in self._steps(session) if s.revision is None), key=arrival)
        for start in range(0, len(found), _PAGE):
            yield found[start : start + _PAGE]

    async def told(self, session: SessionRecord, query: Query, position: int, doubts: Doubts | None = None) -> Told:
        """The verdict records that a query asks for, from a position on."""
        steps = self._steps(session.number)
        if query.ascending:
            found = [s for s in steps if s.position >= position and query.may_match(s)]
        else:
            found = [s for s in reversed(steps) if s.position <= position and query.may_match(s)]
        page = found[:_PAGE]
        rest = page[-1].position + (1 if query.ascending else -1) if len(found) > _PAGE else None

        def look(take: Take) -> int | None:
            return rest if all(map(take, page)) else page[-1].position

        return await self.in_thread(lambda: told(session, query, doubts, look))

    async def episodes(self, query: EpisodeQuery) -> Page:
        """A page of the episodes that a query asks for."""
        return page_of(((kept.record, kept.episodes) for kept in self._kept.values()), query)

    async def timeline(self, session: SessionRecord, question: Question) -> bytes:
        """What a session tells by time, as JSON."""
        kept = self._of(session.number)
        simulated = any(monitor.clock == "sim" for monitor in kept.monitors.values())
        source = StepsSource(kept.steps.copy(), session.decides, simulated=simulated)
        return await self.in_thread(lambda: _encode(answer(source, question, session.properties)))

    async def first_final(self, session: int, order: Order, index: int, upto: int) -> int | None:
        """The position of the first step at which a property is final."""
        steps = (s for s in self._steps(session) if s.order == order and s.position <= upto)
        return next((s.position for s in steps if s.revision is None and s.outcomes[index] in FINAL), None)

    async def last_counted(self, session: int, order: Order, upto: int, undoing: Sequence[StreamKey]) -> int | None:
        """The position of the last step that later ones build on."""
        steps = (s for s in reversed(self._steps(session)) if s.order == order and s.position <= upto)
        return next((s.position for s in steps if s.number is not None and not is_undone(s, undoing)), None)

    async def extents(self) -> list[Extent]:
        """What is kept of each session."""
        found = []
        for number, kept in sorted(self._kept.items()):
            settled = kept.snapshot.settled if kept.snapshot else 0
            extent, refused = await self.extent(number), len(kept.refusals)
            found.append(Extent(number, kept.record.spec, kept.closed, settled, *extent, kept.beside, refused))
        return found

    async def judged_before(self, extent: Extent, time: int) -> int:
        """How many of a session's steps were judged before a time."""
        return sum(step.judged < time for step in self._steps(extent.number))

    async def size(self) -> int:
        """Bytes that the sessions are taken to need."""
        return sum(len(kept.steps) * STEP + kept.beside for kept in self._kept.values())

    def _of(self, session: int) -> Kept:
        """What is kept of a session; of one that was forgotten, nothing, and what is added is lost."""
        return self._kept.get(session) or Kept(_FORGOTTEN)

    def _steps(self, session: int) -> list[StoredStep]:
        return self._of(session).steps
