"""An open session: its monitors, its timer and its ledger around the core's `Session`."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from typing import TypeVarTuple, Unpack

import structlog

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.ordering.credit import Credit
from oracle_server.core.ordering.numbering import Numbering
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged
from oracle_server.core.weakly import weakly
from oracle_server.history.port import History
from oracle_server.history.records import SessionRecord
from oracle_server.history.views import Doubts
from oracle_server.process.clock import Clock
from oracle_server.remote.live import SETTLE_WITHIN, Oracles
from oracle_server.review.restore import Restored
from oracle_server.sessions.backlog import Backlog
from oracle_server.sessions.counters import Counters, counted
from oracle_server.sessions.decoding import Decoders
from oracle_server.sessions.endings import CLOCK_SET_BACK, CLOCK_WENT_BACK
from oracle_server.sessions.judgements import Judgements
from oracle_server.sessions.keeping import Keeping
from oracle_server.sessions.ledger import Ledger
from oracle_server.sessions.monitor import Monitor, Outbox, check_time, claimed, taken
from oracle_server.sessions.presence import Presence
from oracle_server.sessions.shares import Share
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import AnyClock, AnyEvent, Attach, Handling, QuickHandling, ReportMessage

Args = TypeVarTuple("Args")

log = structlog.get_logger()


class LiveSession:
    """One open session. All methods run on the event loop's thread, and none awaits."""

    def __init__(
        self, record: SessionRecord, core: Session, history: History, clock: Clock, counters: Counters,
        backlog: Backlog, share: Share, resume_within: float, request_close: Callable[[LiveSession, str], object],
    ) -> None:  # fmt: skip
        """Run a session; it calls `request_close` with the reason why it is over."""
        self.record = record
        self.id, self.number, self.private, self.opened = record.id, record.number, record.private, record.opened
        self.core, self.spec = core, core.plan.spec
        self.monitors: dict[str, Monitor] = {}
        self.claimed: set[StreamKey] = set()  # by any of them, those that have left among them
        self.credit = Credit(self.spec.ordering.capacity)
        core.divide(share.is_over)
        self.share = share
        """What it takes of the event loop's time; while it rests, its monitors are not read."""
        self.ledger = Ledger(record, core, history, clock, counters, backlog, share, self.monitors, weakly(self._arm))
        self.keeping = Keeping(record, history, self.ledger, self.monitors)
        self.closing = False
        self.went_back = ""
        """Why it is over, where a clock went back: it ignores all further events."""
        self._history, self.clock, self._counters = history, clock, counters
        self._resume_within, self._request_close = resume_within, request_close
        self.presence = Presence(record, self.monitors, clock, self.spec, weakly(self._close_for))
        self.judgements = Judgements()
        self.oracles: Oracles | None = None
        if core.asking is not None:
            judge = weakly(self._judge)
            self.oracles = Oracles(core, weakly(self._enter), lambda judging: share.run(judge, judging))
        self._begun = core.begun is not None
        """Whether the history has when the session began."""
        self.decoder = Decoders(core.plan)
        """The decoder of a stream's data, by its name and kind, which keeps what the session reads of it."""
        self._timer: asyncio.TimerHandle | None = None
        self._armed: int | None = None

    async def vacate(self, wanted: Attach) -> bool:
        """Let go of the connection of another process of a monitor's name, if its peer is not reached any more.

        Returns whether there was one. Raises a fatal `WireError` where that process is there.
        """
        monitor = self.monitors.get(wanted.monitor)
        if monitor is None or monitor.outbox is None or monitor.instance == wanted.instance:
            return False
        outbox = monitor.outbox
        if await outbox.reached():
            raise taken(monitor.name)
        log.info("monitor is not reached any more", session=self.id, monitor=monitor.name)
        outbox.drop(WireError("replaced", "another process of the name took over", fatal=True))
        self.disconnected(monitor, outbox)
        return True

    def attach(self, wanted: Attach, outbox: Outbox) -> Monitor:
        """Attach a monitor. Raises a fatal `WireError` where it is refused."""
        streams = claimed(self.spec, wanted)
        self._set_time(wanted)
        monitor = self.monitors.get(wanted.monitor)
        if monitor is not None and monitor.instance == wanted.instance:
            self.core.clocks.trust(monitor.name, wall=self.core.simulated is None)
        if monitor is None:
            monitor = self.monitors[wanted.monitor] = Monitor(wanted.monitor, wanted.instance, Numbering())
        if monitor.outbox is not None:
            if monitor.instance != wanted.instance:
                raise taken(monitor.name)
            monitor.outbox.drop(WireError("replaced", "a newer connection of this process took over", fatal=True))
        monitor.attach(wanted, outbox, streams)
        self.claimed.update(streams)
        self.core.bypass(monitor.name, monitor.bypasses)
        if wanted.verdicts:
            self.ledger.follow_verdicts()
        self._set_attached(monitor, attached=True)
        self.core.returning.came(monitor.name, self.clock.now())
        self.credit.open(monitor.name)
        self._judge(self.core.attach, monitor.name, streams, self._enter())
        return monitor

    @property
    def is_behind(self) -> bool:
        """Whether an event would have to wait for deadlines that have expired, or for what is judged again."""
        if self.closing or self.keeping.failed or (self.core.buffer.due is not None and not self.core.is_revising):
            return False
        return self.core.is_behind or (self._armed is not None and self._armed <= self.clock.now())

    async def caught_up(self) -> None:
        """Judge that in turns, between which others are served, until nothing of it is left."""
        while self.is_behind:
            armed = self._armed
            self.share.run(self._tick)
            if self._armed == armed and not self.core.is_behind:
                return
            await asyncio.sleep(self.share.rest)

    def ingest(self, monitor: Monitor, message: AnyEvent) -> list[Judged]:
        """Ingest an event, and return the steps that were judged because of it.

        A duplicate is not judged, but its decision is sent again. Raises `WireError` where the event is refused.
        """
        if self._ignores_events:
            return []
        self.credit.spend(monitor.name)
        gap = monitor.numbering.take(message.seq)
        if gap is None:
            self.ledger.answer_duplicate(monitor, message)
            self._count_duplicate(monitor, StreamKey(message.stream, message.kind))
            return []
        key = StreamKey(message.stream, message.kind)
        if key not in monitor.streams:
            why = "was not claimed at attach" if key in self.spec.by_key else f"is no stream of {self.spec.id}"
            raise self.ledger.refuse(monitor, message.seq, gap, "unknown_stream", f"{key} {why}")
        monitor.gaps[message.seq] = gap
        monitor.unsettled += 1
        event = Event(
            key, monitor.name, message.seq, message.stamp or None, self._enter(), message.data, message.source,
            message.call, message.lost + monitor.lost + gap, message.ask, None, message.goal_id, message.status,
        )  # fmt: skip
        monitor.lost = 0
        return self._judge(self.core.ingest, event)

    def refuse(self, monitor: Monitor, error: WireError) -> None:
        """Refuse an event that could not be read; its number is used up."""
        self.credit.spend(monitor.name)
        if error.seq is not None and not self._ignores_events:
            gap = monitor.numbering.take(error.seq)
            if gap is not None:
                self.ledger.refuse(monitor, error.seq, gap, error.code, error.message)

    def update_clocks(self, monitor: Monitor, message: AnyClock) -> None:
        """Update the clocks of a monitor's streams. Raises `WireError` where it did not claim one of them."""
        if self._ignores_events:
            return
        readings = [ClockReading(StreamKey(s.stream, s.kind), s.stamp) for s in message.stamps]
        claimed = [r for r in readings if r.stream in monitor.streams]
        if self.core.goes_back(monitor.name, claimed):
            self.went_back = CLOCK_SET_BACK if self.core.simulated is None else CLOCK_WENT_BACK
            log.warning("a clock went back", session=self.id, monitor=monitor.name, reason=self.went_back)
            self._close_for(self.went_back)
            return
        self._judge(self.core.clock, monitor.name, claimed, self._enter())
        if len(claimed) < len(readings):
            raise WireError("unknown_stream", "the clock names a stream that was not claimed at attach")

    def report(self, monitor: Monitor, message: ReportMessage) -> None:
        """Store a monitor's reports on its streams; the session's state shows them. Raises `WireError`."""
        unknown, changed = False, False
        for report in message.streams:
            if StreamKey(report.stream, report.kind) in monitor.streams:
                changed = monitor.report(report, self.clock.now()) or changed
            else:
                unknown = True
        if changed and not self.closing:
            self.core.bypass(monitor.name, monitor.bypasses)
            self.ledger.restate(monitor.record())
        if unknown:
            raise WireError("unknown_stream", "the report names a stream that was not claimed at attach")

    def record_handling(self, monitor: Monitor, message: Handling | QuickHandling) -> None:
        """Record what the adapter did with an event that it asked about."""
        if message.seq in monitor.gaps:
            monitor.handlings[message.seq] = (message.passed, message.why)
        else:
            self.ledger.amend(monitor, message)

    def detach(self, monitor: Monitor) -> None:
        """Detach a monitor; `detached` is sent once all its events are committed."""
        monitor.detaching = True
        self._leave(monitor)
        monitor.confirm_detach()

    def disconnected(self, monitor: Monitor, outbox: Outbox) -> None:
        """Keep a monitor whose connection is lost attached until it reconnects, or its time to do so expires."""
        if monitor.outbox is not outbox:
            return
        monitor.outbox = None
        if monitor.attached and not self.closing:
            monitor.expiry = asyncio.get_running_loop().call_later(self._resume_within, self._expire, monitor)

    async def drain(self) -> None:
        """Before `close`: judge all held events in turns, between which other sessions are served; take no more."""
        self.closing = True
        while not self.keeping.failed and (self.core.has_due or self.core.release()):
            self.share.run(lambda: self._judge(self.core.advance, self._enter()))
            await asyncio.sleep(0)

    def close(self) -> None:
        """Judge all held events, in order, and stop the timers."""
        self.closing = True
        self.presence.stop()
        self._judge(self.core.finish, self._enter())
        self.ledger.write()
        if self._timer:
            self._timer.cancel()
            self._armed = self._timer = None
        for monitor in self.monitors.values():
            if monitor.expiry:
                monitor.expiry.cancel()

    def end(self) -> None:
        """After `close` and `settle`: judge what is still open, since nothing will come any more."""
        self._judge(self.core.end, self._enter())
        self.ledger.end()

    def go_on(self) -> None:
        """Take events again after a close that failed; what ends the session is checked again later."""
        self.closing = False
        for name in (monitor.name for monitor in self.monitors.values() if not monitor.attached):
            self._judge(self.core.detach, name, self._enter())
        self.await_monitors()

    def await_monitors(self) -> None:
        """From now on, keep the places of monitors without a connection for `resume_within`, and an empty session."""
        loop = asyncio.get_running_loop()
        for monitor in self.monitors.values():
            if monitor.attached and monitor.outbox is None:
                if monitor.expiry:
                    monitor.expiry.cancel()
                monitor.expiry = loop.call_later(self._resume_within, self._expire, monitor)
        loop.call_later(self._resume_within, self._end_if_over)

    async def settle(self, within: float = SETTLE_WITHIN) -> None:
        """After `close`, wait some seconds for the answers of external oracles to the held events."""
        if self.oracles is not None:
            await self.oracles.settle(within)
            self.ledger.write()

    def resume(self, restored: Restored) -> None:
        """Continue a restored session: hold its events again, and keep its monitors' places until `await_monitors`."""
        self.ledger.resume(restored)
        if any(known.clock == "sim" for known in restored.monitors.values()):
            self.core.simulate()
        for name, known in restored.monitors.items():
            monitor = self.monitors[name] = Monitor(name, known.instance, known.numbering)
            monitor.lost, monitor.left = known.lost, known.left
            self.claimed.update(known.streams)
            if known.attached:
                monitor.attached, monitor.streams, monitor.clock = True, known.streams, known.clock
                monitor.bypasses = dict(known.bypasses)
                self.core.bypass(name, monitor.bypasses)
                self.core.returning.expect(name)
                self._deliver(self.core.attach(name, monitor.streams, self._enter()))
        self.presence.note(max(self.opened, self.core.now))
        for step, gap in restored.held:
            monitor = self.monitors[step.event.monitor]
            monitor.numbering.hold(step.event.seq)
            monitor.unsettled += 1
            monitor.gaps[step.event.seq] = gap
            self._deliver(self.core.hold(step))

    @property
    def doubts(self) -> Doubts | None:
        """Which verdicts may still be revised, None where none ever is."""
        late = self.core.lateness
        return None if late is None else Doubts(late.judge.newest - late.judge.horizon, self.core.plan.readers)

    def counts(self) -> Counter[str]:
        """The session's counts so far, by the names of the metrics."""
        return counted(self.core, self.ledger.refused)

    @property
    def _ignores_events(self) -> bool:
        return bool(self.closing or self.went_back or self.keeping.failed is not None)

    def _set_time(self, wanted: Attach) -> None:
        """Let the first monitor choose wall or simulated time. Raises a fatal `WireError` where another one differs."""
        if not self.monitors and wanted.clock == "sim":
            self.core.simulate()
        check_time(self.id, wanted, "wall" if self.core.simulated is None else "sim")

    def _enter(self) -> int:
        """Suspend judging while the history can't be written, and return the present time in nanoseconds."""
        self.core.suspended = self._history.failure is not None or self.keeping.trouble is not None
        return self.clock.now()

    def _set_attached(self, monitor: Monitor, *, attached: bool) -> None:
        monitor.attached, monitor.left = attached, None if attached else self.clock.now()
        self.presence.note()
        self.share.set_awaited(awaited=any(m.attached for m in self.monitors.values()))
        self._history.set_monitor(self.number, monitor.record())

    def _close_for(self, reason: str) -> None:
        if not self.closing:
            self._request_close(self, reason)

    def _expire(self, monitor: Monitor) -> None:
        monitor.expiry = None
        log.info("monitor did not reconnect", session=self.id, monitor=monitor.name)
        self._leave(monitor)

    def _leave(self, monitor: Monitor) -> None:
        if monitor.attached:
            monitor.bypasses.clear()
            self.core.bypass(monitor.name, {})
            self._set_attached(monitor, attached=False)
            self.core.returning.left(monitor.name, self.clock.now())
            self.core.clocks.leave(monitor.name)
            self.credit.close(monitor.name)
            if not self.closing:  # time passes no more, since events are taken no more
                self._judge(self.core.detach, monitor.name, self._enter())
        self.presence.leave_empty()

    def _end_if_over(self) -> None:
        if self.went_back:
            self._close_for(self.went_back)
        self.presence.leave_empty()
        self.presence.watch()

    def _count_duplicate(self, monitor: Monitor, key: StreamKey) -> None:
        if key in self.spec.by_key:
            self.core.counts[monitor.name, key].duplicates += 1

    def _judge(self, judging: Callable[[Unpack[Args]], list[Judged]], *args: *Args) -> list[Judged]:
        """Have something judged and delivered; where that fails, nothing of the session is judged any more."""
        if self.keeping.failed:
            return []
        try:
            judged = judging(*args)
            self._deliver(judged)
        except Exception as error:  # noqa: BLE001 -- whatever it is, what is judged of it then would be wrong
            self.keeping.fail(error)
            return []
        return judged

    def _deliver(self, judged: list[Judged]) -> None:
        """Send decisions and credit at once, and queue the steps for the history."""
        if not self._begun and self.core.begun is not None:
            self._begun = True
            self._history.begin_session(self.number, self.core.begun)
        for item in judged:
            if item.decision:
                kept = not (self.core.suspended and self._history.adrift)
                self.monitors[item.step.event.monitor].decide(item, item.decision, send=kept)
                self._counters.decisions.add(self.clock.now() - item.step.event.came)
        if self.oracles is not None:
            self.oracles.ask()
        if judged:
            self.judgements.note(judged)
            self.ledger.add(judged)
        for name, events in self.credit.grant(self.core.buffer):
            if outbox := self.monitors[name].outbox:
                outbox.send({"type": "credit", "events": events})
        self._arm()

    def _arm(self) -> None:
        """Set the session's one timer to the earliest time at which something is judged without a further event."""
        deadline = self.core.next_deadline
        if deadline is None or self.closing or (self._armed is not None and self._armed <= deadline):
            return
        if self._timer:
            self._timer.cancel()
        delay = self.share.rest if self.core.is_behind else max(0, deadline - self.clock.now()) / 10**9
        self._armed, self._timer = deadline, asyncio.get_running_loop().call_later(delay, self.share.run, self._tick)

    def _tick(self) -> None:
        if self._timer:
            self._timer.cancel()
        self._armed = self._timer = None
        self._judge(self.core.advance, self._enter())
