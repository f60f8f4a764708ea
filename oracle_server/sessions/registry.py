"""All sessions of a server: opened, found, restored, closed."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import structlog

from oracle_server.core.errors import OracleError, SpecError
from oracle_server.core.events import By
from oracle_server.core.plan import Plan, judged_by
from oracle_server.core.session import Session
from oracle_server.history.port import History
from oracle_server.history.readers import reading_for
from oracle_server.history.records import Document, SessionRecord
from oracle_server.history.whose import ALL, Whose
from oracle_server.process.clock import Clock
from oracle_server.remote.live import SETTLE_WITHIN
from oracle_server.review.restore import restore
from oracle_server.sessions.alarms import SessionAlarms, Sink, session_ended
from oracle_server.sessions.backlog import Backlog
from oracle_server.sessions.commits import Commits
from oracle_server.sessions.counters import Counters
from oracle_server.sessions.elsewhere import Left, Others
from oracle_server.sessions.endings import BY_REQUEST, CLOCK_SET_BACK, Runs, end_of, ended, is_ahead, note_closed, over
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor, Outbox, claimed
from oracle_server.sessions.opening import Begun, Records, SessionExistsError, SessionNameError, fresh, unopened
from oracle_server.sessions.recorded import RecordedSession
from oracle_server.sessions.restoring import Restoring
from oracle_server.sessions.shares import Shares
from oracle_server.sessions.status import present_state, session_state
from oracle_server.sessions.stopping import adrift, demand_having, demand_keeping, leave, let_go, settle, stops
from oracle_server.sessions.summary import LISTED
from oracle_server.sessions.unrestored import Unrestored
from oracle_server.specfiles.library import Entry, Library, UnknownSpecError
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import Attach

log = structlog.get_logger()


class SessionStaysOpenError(OracleError):
    """A session that could not be closed."""


class Registry:
    """The open sessions, and the closed ones by their records in the history."""

    def __init__(
        self, history: History, library: Library, clock: Clock, resume_within: float, shares: Shares | None = None,
        alarms: Sink | None = None,
    ) -> None:  # fmt: skip
        """Begin without sessions; `resume_within` is how long (s) a monitor stays attached without a connection.

        `alarms` is told of violations, and of sessions that end.
        """
        self.open: dict[str, LiveSession] = {}
        self.unrestored: dict[str, Unrestored] = {}
        """Those that are open in the history, and not judged: they could not be restored, or are being closed."""
        self.recorded: dict[str, RecordedSession] = {}
        """Those in which recordings are judged."""
        self.backlog = Backlog()
        self.counters = Counters()
        self._history, self._library, self._clock, self._resume_within = history, library, clock, resume_within
        self.shares, self._alarms = shares or Shares(), alarms
        self.others = Others(history)
        """The sessions that other servers have."""
        self._restoring = Restoring(history, library, clock, self.open, self.unrestored, self._restore)
        self._runs = Runs(history, self.open, self.unrestored)
        self._opening = asyncio.Lock()
        self._builders = ThreadPoolExecutor(1, "session opening")
        self._closing: dict[int, asyncio.Task[None]] = {}
        self._stopping = False
        self._records = Records(history, clock, self.known)
        self.demand_free = self._records.demand_free

    async def restore_all(self) -> None:
        """Restore the open sessions from the history. One that can't be restored is logged, and among `unrestored`.

        The places of their monitors are kept until `accept_work`, however long this takes. Sessions that are ahead of
        the machine's clock are closed, and begin anew. Raises `HistoryError`.
        """
        self._records.last = await self._history.last_number()
        await self._restoring.restore_each(await self._history.open_sessions())
        for session in [live for live in self.open.values() if is_ahead(live.core, live.clock)]:
            log.warning("a session is closed, and goes on as another run", session=session.id, reason=CLOCK_SET_BACK)
            self._begin_to_close(session, CLOCK_SET_BACK)

    def accept_work(self) -> None:
        """Begin to count how long the monitors of restored sessions stay away: from now on they can come back."""
        for session in self.open.values():
            session.await_monitors()

    async def take_over(self) -> None:
        """Go on with the sessions of servers whose lease has run out.

        Raises `HistoryError`: what is not restored by then is by the next call.
        """
        if self._stopping:
            return
        had = [one.record.number for one in self.open.values()]
        had += [one.record.number for one in self.unrestored.values()]
        had += [one.record.number for one in self.recorded.values()]
        with self._records.noting() as new:
            found = await self._history.take_over(had)
        for record in [one for one in found if one.number not in new]:  # those were opened here meanwhile
            await self._restoring.restore_each([record])
            if record.id in self.open and not self._stopping:
                self.open[record.id].await_monitors()

    def let_go(self) -> None:
        """Drop all monitors: another server may have their sessions by now."""
        let_go(self.open.values(), adrift())

    async def attach(self, wanted: Attach, outbox: Outbox) -> tuple[LiveSession, Monitor]:
        """Attach a monitor to the session that it names, or to a new one. Raises a fatal `WireError`."""
        demand_keeping(self._history)
        session = await self._session_for(wanted)
        demand_having(self._history, stopping=self._stopping)
        if wanted.spec is not None and wanted.spec != session.spec.id:
            message = f"session '{session.id}' judges by '{session.spec.id}', not by '{wanted.spec}'"
            raise WireError("spec_mismatch", message, fatal=True)
        session.keeping.check()
        return session, session.attach(wanted, outbox)

    async def create(
        self, spec_id: str, session_id: str | None, *, private: bool = False, by: By | None = None
    ) -> LiveSession:
        """Open a new session; `by` overrides the order that its spec asks for.

        Raises `UnknownSpecError`, `SpecError`, `SessionExistsError` or `SessionNameError`, `HistoryError` where the
        history fails, and `WireError` where the server stops.
        """
        with contextlib.suppress(OracleError):  # told below; others are not kept waiting while a changed file is read
            await self._library.find(spec_id)
        async with self._opening:
            with reading_for():  # whoever asks: attaches wait for this, too
                await self.demand_free(session_id)  # whatever spec is asked for
                entry = await self._library.find(spec_id)
                session_id = session_id or await self._records.new_name(spec_id)
            return await self._open(entry, session_id, private, by)

    async def create_recorded(
        self, entry: Entry, session_id: str | None, begun: Begun, cancel: Callable[[], object]
    ) -> RecordedSession:
        """Open a session for a recording that is judged elsewhere by a spec; `cancel` ends that. Raises as `create`."""
        async with self._opening:
            with reading_for():
                await self.demand_free(session_id)
                session_id = session_id or await self._records.new_name(entry.id)
            record = await self._records.make(entry, session_id, begun, kind="recording")
            if self._stopping:
                raise stops()
            self.recorded[session_id] = RecordedSession(record, self._history, self.shares.share(), cancel)
            return self.recorded[session_id]

    async def close_recorded(self, session: RecordedSession, because: str, *, complete: bool) -> None:
        """Close the session of a recording; one that is not complete says so."""
        await session.close(self._clock.now(), because, complete=complete)
        self.recorded.pop(session.record.id, None)
        session.end()

    async def flush(self) -> None:
        """Wait until everything that was written to the history is committed."""
        await self._history.flush()

    async def known(self, session_id: str) -> SessionRecord | None:
        """The record of an open or closed session, None where there is none of that name. Raises `HistoryError`."""
        live = self.open.get(session_id) or self.recorded.get(session_id)
        return live.record if live is not None else await self._history.session(session_id)

    def commits(self, session_id: str) -> Commits | None:
        """The commits of a session, None where it is closed."""
        live, recorded = self.open.get(session_id), self.recorded.get(session_id)
        return live.ledger.commits if live is not None else recorded.commits if recorded is not None else None

    async def state(self, session_id: str) -> Document | None:
        """A session's state, as of its end where it is closed; None where it is unknown. Raises `HistoryError`."""
        live, unrestored = self.open.get(session_id), self.unrestored.get(session_id)
        if live is not None:
            return await present_state(live, live.clock.now())
        if unrestored is not None:
            return unrestored.state
        recorded = self.recorded.get(session_id)
        if recorded is not None:
            return recorded.state
        return await self._history.closed_state(session_id) or await self.others.state(session_id)

    async def states(self, whose: Whose = ALL) -> list[dict[str, Any]]:
        """The states of open sessions, then of the last closed ones that are asked of. Raises `HistoryError`."""
        live = []
        if whose.origin is None:  # what is forwarded is never open here
            for session in [*reversed(self.open.values())]:
                live.append(await present_state(session, session.clock.now()))
                await asyncio.sleep(0)  # so that decisions wait for one state, not for a thousand
            live += [one.state for one in self.recorded.values()] + [one.state for one in self.unrestored.values()]
        live += await self.others.states(whose.origin)
        listed = {state["id"] for state in live}  # one of these may be closed meanwhile
        closed = await self._history.closed_states(LISTED, whose)
        return [*live, *(state for state in closed if state["id"] not in listed)]

    async def _close(self, session: LiveSession, because: str) -> None:
        """Judge what a session holds, and close it, unless the server stops: the next server restores it then."""
        if session.closing:
            return
        await session.drain()
        if self._stopping:
            return
        session.close()
        await session.settle()
        session.end()
        now = session.clock.now()
        successor = await self._successor(session) if session.went_back else None
        state = session_state(session, now) | end_of(now, because)
        state |= {"continued_by": successor, "clock_went_back": bool(session.went_back)}
        await note_closed(self._history, session.number, now, state)
        self.open.pop(session.id, None)
        if self._alarms:
            self._alarms.send(session_ended(session.record, state))
        session.ledger.snapshots.end()
        self.counters.add_closed(session.counts(), session.core.holds)
        session.ledger.commits.end()
        if session.went_back:
            reason = ended(session.id, because, successor)
        else:
            reason = WireError("session_closed", f"session '{session.id}' was closed: {because}", fatal=True)
        for monitor in session.monitors.values():
            if monitor.outbox and not monitor.detaching:
                monitor.outbox.drop(reason)

    def save(self, number: int) -> None:
        """Take a snapshot of an open session, unless the last one was taken too recently."""
        for session in self.open.values():
            judged = not session.closing and session.keeping.failed is None
            if session.number == number and judged and session.ledger.snapshots.rested:
                session.share.run_for_server(session.ledger.save)

    async def end(self, name: str, within: float, because: str = BY_REQUEST) -> bool:
        """Close the session of a name, if it is open, and return whether it is closed within `within` seconds.

        Raises as `closed_within` does, and `OtherServerError` where another server has it.
        """
        session, unrestored, recorded = self.open.get(name), self.unrestored.get(name), self.recorded.get(name)
        if session is not None:
            return await self.closed_within(session, within, because)
        if recorded is not None:
            recorded.cancel()
            return await recorded.closed_within(within)
        left = unrestored or await self.others.left(name)
        return left is None or await self._abandon(left, within, because)

    async def closed_within(self, session: LiveSession, within: float, because: str = BY_REQUEST) -> bool:
        """Close a session, and return whether it is closed within `within` seconds; else the closing continues.

        Raises `SessionStaysOpenError` where it failed, and `WireError` where the server stops; it stays open then.
        """
        _, waiting = await asyncio.wait((self._begin_to_close(session, because),), timeout=within)
        if not waiting and self.open.get(session.id) is session:
            reason = f"session '{session.id}' could not be closed, and stays open; see the server's log"
            raise stops() if self._stopping else SessionStaysOpenError(reason)
        return not waiting

    async def _abandon(self, left: Unrestored | Left, within: float, because: str) -> bool:
        """Close a session that nobody judges, as it stands; returns whether it is within so many seconds.

        Else it is closed as soon as the history can be written.
        """
        now, known, gone = self._clock.now(), left.record, asyncio.Event()
        state = left.state | end_of(now, because) | {"continued_by": None, "clock_went_back": False}

        def closed() -> None:
            gone.set()
            self.unrestored.pop(known.id, None)
            if self._alarms:
                self._alarms.send(session_ended(known, state))

        self._history.close_session(known.number, now, state, closed)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within):
                await self._history.flush()
        return gone.is_set()

    async def shut_down(self, settle_within: float = SETTLE_WITHIN) -> None:
        """Judge what all sessions hold, commit it, and close the connections; in the history the sessions stay open.

        Where another server may have them, it judges what they hold. Oracles have `settle_within` seconds to answer.
        """
        self._stopping = True
        if not self._history.adrift:
            await settle(self.open.values(), self._history, settle_within)
        await leave(self.open.values())

    async def _session_for(self, wanted: Attach) -> LiveSession:
        """The session that a monitor names, or a new one; a fatal `WireError` where there is none to join."""
        if wanted.session is not None:
            joined = await self._joined(wanted.session, wanted.instance)
            if joined is not None:
                return await self._session_for(wanted) if await joined.vacate(wanted) else joined
        if wanted.spec is None:
            raise WireError("unknown_spec", "name a spec: there is no session to join", fatal=True)
        try:
            claimed((await self._library.find(wanted.spec)).plan.spec, wanted)
            return await self.create(wanted.spec, wanted.session, private=wanted.session is None)
        except SessionExistsError:
            return await self._session_for(wanted)
        except (UnknownSpecError, SpecError, SessionNameError) as error:
            raise unopened(error) from None

    async def _joined(self, name: str, instance: str) -> LiveSession | None:
        """The open session of a name that a process wants to join, None where it is a new name.

        Raises a fatal `WireError` where it is closed; it names the one to attach to where it begins anew.
        """
        while (live := self.open.get(name)) is not None:
            if live.number not in self._closing:
                return live
            await asyncio.wait((self._closing[live.number],))  # its successor is not known before
        if name in self.recorded:
            raise WireError("session_closed", f"session '{name}' judges a recording; take another name", fatal=True)
        unrestored = self.unrestored.get(name)
        if unrestored is not None:
            why = f"session '{name}' could not be restored, and can only be read or closed: {unrestored.brief}"
            raise WireError("session_closed", why, fatal=True)
        record = await self.known(name)
        moved = await self.others.moved(name, known=record is not None)
        if moved is not None and name not in self.open:
            raise moved
        if record is None and not await self._runs.goes_on(name):
            return None
        state = await self.state(name)
        if name in self.open:  # another monitor has opened it meanwhile
            return await self._joined(name, instance)
        if record is None:  # and later runs are known
            raise ended(name, "its history was deleted", await self._runs.anew(name))
        if state is None:
            raise WireError("session_closed", f"session '{name}' was just forgotten; attach again", fatal=True)
        raise await over(record, state, instance, self._history, self._runs)

    async def _open(self, entry: Entry, session_id: str, private: bool, by: By | None) -> LiveSession:
        ready = judged_by(entry.plan, by)
        core = await asyncio.get_running_loop().run_in_executor(self._builders, fresh, ready)
        record = await self._records.make(entry, session_id, Begun(by, next(iter(core.judges))), private=private)
        if self._stopping:
            raise stops()
        live = self._live(record, core)
        live.presence.watch()
        self._history.open_session(record)
        log.info("session opened", session=session_id, spec=record.spec)
        return live

    async def _restore(self, opened: SessionRecord, ready: Plan) -> None:
        restored = await restore(self._history, opened.number, ready)
        live = self._live(opened, restored.core)
        live.resume(restored)
        if live.oracles is not None and restored.position:
            live.oracles.resume()
        self.counters.exclude(live.counts())
        log.info("session restored", session=opened.id, steps=restored.position)

    def _live(self, record: SessionRecord, core: Session) -> LiveSession:
        clock = self._clock.since(core.now)
        if clock is not self._clock and clock.far:
            log.warning("a session goes on by a time that is ahead of the wall clock; close it", session=record.id)
        live = LiveSession(
            record, core, self._history, clock, self.counters, self.backlog, self.shares.share(), self._resume_within,
            self._begin_to_close,
        )  # fmt: skip
        self.open[live.id] = live
        self.counters.violated.expect(record.spec, record.properties)
        if self._alarms:
            live.ledger.alarms = SessionAlarms(record, core, self._alarms)
        return live

    async def _successor(self, session: LiveSession) -> str | None:
        """The name of the session that continues one whose clock went back; None for a private one."""
        if session.private:
            return None
        return await self._runs.following(session.id)

    def _begin_to_close(self, session: LiveSession, because: str) -> asyncio.Task[None]:
        task = self._closing.get(session.number)
        if task is None:
            task = self._closing[session.number] = asyncio.get_running_loop().create_task(self._close(session, because))
            task.add_done_callback(lambda ended: self._closing_ended(session, ended))
        return task

    def _closing_ended(self, session: LiveSession, task: asyncio.Task[None]) -> None:
        self._closing.pop(session.number)
        error = None if task.cancelled() else task.exception()
        if error is not None:
            if not self._stopping:
                session.go_on()
            log.error("a session can't be closed", session=session.id, exc_info=error)
