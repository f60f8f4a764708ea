"""A session as the server runs it: its monitors, its timer and its ledger around the core's `Session`."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable

import structlog

from oracle_server.core.credit import Credit
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.numbering import Numbering
from oracle_server.core.session import Session
from oracle_server.core.simulated import ClockReading, SimulatedTime
from oracle_server.core.verdicts import Judged, decision_frame
from oracle_server.history.port import History
from oracle_server.history.records import MonitorRecord, SessionRecord
from oracle_server.process.clock import Clock
from oracle_server.remote.live import Oracles
from oracle_server.review.restore import Restored
from oracle_server.sessions.counters import Counters
from oracle_server.sessions.ledger import Ledger
from oracle_server.sessions.monitor import Monitor, Outbox, check_time, claimed
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import AnyClock, AnyEvent, Attach, Handling, QuickHandling, ReportMessage

log = structlog.get_logger()


class LiveSession:
    """One open session. All methods run on the event loop's thread, and none awaits."""

    def __init__(
        self, record: SessionRecord, core: Session, history: History, clock: Clock, counters: Counters,
        resume_within: float, on_over: Callable[[LiveSession], None],
    ) -> None:  # fmt: skip
        """Run a session; `on_over` is called when it is to be closed: its last monitor gone, or its time gone back."""
        self.record = record
        self.id, self.number, self.private, self.opened = record.id, record.number, record.private, record.opened
        self.core, self.spec = core, core.plan.spec
        self.monitors: dict[str, Monitor] = {}
        self.credit = Credit(self.spec.ordering.capacity)
        self.ledger = Ledger(record, core, history, clock, counters, self.monitors)
        self.closing = False
        self.clock_went_back = False
        """Whether its simulation began anew, so that it takes nothing more."""
        self._history, self._clock, self._counters = history, clock, counters
        self._resume_within, self._on_over = resume_within, on_over
        self.oracles = None if core.asking is None else Oracles(core, self._enter, self._deliver)
        self._timer: asyncio.TimerHandle | None = None
        self._armed: int | None = None

    def attach(self, wanted: Attach, outbox: Outbox) -> Monitor:
        """Attach a monitor. Raises a fatal `WireError` where that can't be."""
        streams = claimed(self.spec, wanted.streams)
        self._set_time(wanted)
        monitor = self.monitors.get(wanted.monitor)
        if monitor is None:
            monitor = self.monitors[wanted.monitor] = Monitor(wanted.monitor, wanted.instance, Numbering())
        if monitor.outbox is not None:
            if monitor.instance != wanted.instance:
                raise WireError("monitor_taken", f"another process is attached as '{wanted.monitor}'", fatal=True)
            monitor.outbox.drop(WireError("replaced", "a newer connection of this process took over", fatal=True))
        if monitor.expiry:
            monitor.expiry.cancel()
            monitor.expiry = None
        if monitor.instance == wanted.instance:
            monitor.numbering.resume()
        else:
            monitor.numbering.restart()
        monitor.instance, monitor.outbox, monitor.streams, monitor.detaching = wanted.instance, outbox, streams, False
        monitor.clock = wanted.clock
        monitor.verdicts = wanted.verdicts
        if wanted.verdicts:
            self.ledger.follow_verdicts()
        self._set_attached(monitor, attached=True)
        self._look_who_is_back()
        self.credit.open(monitor.name)
        self._deliver(self.core.attach(monitor.name, streams, self._enter()))
        return monitor

    @property
    def has_room(self) -> bool:
        """Whether it takes more events; else its monitors are not read until it does."""
        return self._history.has_room and self.ledger.answers.has_room

    async def room(self) -> None:
        """Wait until it takes more events."""
        await self._history.room()
        await self.ledger.answers.room()

    def tell_verdicts(self, monitor: Monitor) -> None:
        """Tell a monitor that wants to know how the properties stand; to be called once its past is committed."""
        self.ledger.tell_verdicts(monitor)

    def ingest(self, monitor: Monitor, message: AnyEvent) -> list[Judged]:
        """Take an event, and tell what was judged by it: once; it is answered again where it is sent again.

        Raises `WireError`.
        """
        if self._takes_no_more:
            return []
        self.credit.spend(monitor.name)
        gap = monitor.numbering.take(message.seq)
        if gap is None:
            self._count_again(monitor, StreamKey(message.stream, message.kind))
            self.ledger.answer_again(monitor, message)
            return []
        key = StreamKey(message.stream, message.kind)
        if key not in monitor.streams:
            why = "was not claimed at attach" if key in self.spec.by_key else f"is no stream of {self.spec.id}"
            raise self.ledger.refuse(monitor, message.seq, gap, "unknown_stream", f"{key} {why}")
        monitor.gaps[message.seq] = gap
        monitor.unsettled += 1
        event = Event(
            key, monitor.name, message.seq, message.stamp or None, self._enter(), message.data, message.source,
            message.call, message.lost + monitor.lost + gap, message.ask,
        )  # fmt: skip
        monitor.lost = 0
        judged = self.core.ingest(event)
        self._deliver(judged)
        return judged

    def refuse(self, monitor: Monitor, error: WireError) -> None:
        """Use up the number of an event that could not be read."""
        self.credit.spend(monitor.name)
        if error.seq is not None and not self._takes_no_more:
            gap = monitor.numbering.take(error.seq)
            if gap is not None:
                self.ledger.refuse(monitor, error.seq, gap, error.code, error.message)

    def clock(self, monitor: Monitor, message: AnyClock) -> None:
        """Learn how far a monitor's streams have come."""
        if self._takes_no_more:
            return
        readings = [ClockReading(StreamKey(s.stream, s.kind), s.stamp) for s in message.stamps]
        claimed = [r for r in readings if r.stream in monitor.streams]
        if self.core.simulated is not None and self.core.simulated.goes_back(monitor.name, claimed):
            log.info("simulated time went back", session=self.id, monitor=monitor.name)
            self.clock_went_back = True
            self._on_over(self)
            return
        self._deliver(self.core.clock(monitor.name, claimed, self._enter()))
        if len(claimed) < len(readings):
            raise WireError("unknown_stream", "the clock names a stream that was not claimed at attach")

    def report(self, monitor: Monitor, message: ReportMessage) -> None:
        """Keep what a monitor says of its streams, for who asks how the session stands."""
        for said in message.streams:
            key = StreamKey(said.stream, said.kind)
            if key not in monitor.streams:
                raise WireError("unknown_stream", "the report names a stream that was not claimed at attach")
            monitor.reports[key] = said

    def outcome(self, monitor: Monitor, message: Handling | QuickHandling) -> None:
        """Keep what the adapter did about an event that it asked about."""
        if message.seq in monitor.gaps:
            monitor.handlings[message.seq] = (message.passed, message.why)
        else:
            self.ledger.amend(monitor, message)

    def detach(self, monitor: Monitor) -> None:
        """Let a monitor go: it is told once all that it sent is committed."""
        monitor.detaching = True
        self._leave(monitor)
        monitor.let_go()

    def disconnected(self, monitor: Monitor, outbox: Outbox) -> None:
        """Keep the place of a monitor whose connection is lost, for a while."""
        if monitor.outbox is not outbox:
            return
        monitor.outbox = None
        if monitor.attached:
            loop = asyncio.get_running_loop()
            monitor.expiry = loop.call_later(self._resume_within, self._expire, monitor)

    def close(self) -> None:
        """Judge all that is held, in order, and stop the timers."""
        self.closing = True
        self._deliver(self.core.finish(self._enter()))
        self.ledger.write()
        if self._timer:
            self._timer.cancel()
            self._armed = self._timer = None
        for monitor in self.monitors.values():
            if monitor.expiry:
                monitor.expiry.cancel()

    def go_on(self) -> None:
        """Take events again, as it could not be closed; what would end it is looked for again."""
        self.closing = False
        loop = asyncio.get_running_loop()
        for monitor in self.monitors.values():
            if monitor.attached and monitor.outbox is None:
                monitor.expiry = loop.call_later(self._resume_within, self._expire, monitor)
        loop.call_later(self._resume_within, self._end_if_over)

    async def settle(self) -> None:
        """Once closed, wait a while for what oracles elsewhere say of what was held."""
        if self.oracles is not None:
            await self.oracles.settle()
            self.ledger.write()

    def resume(self, restored: Restored) -> None:
        """Go on where a session stood: give its monitors their time to come back, and put back what was held."""
        self.ledger.resume(restored.position, restored.refused)
        loop = asyncio.get_running_loop()
        if any(known.clock == "sim" for known in restored.monitors.values()):
            self.core.simulated = SimulatedTime(self.spec.by_key)
        if self.core.simulated is None and any(known.attached for known in restored.monitors.values()):
            self.core.ready_since = None
        for name, known in restored.monitors.items():
            monitor = self.monitors[name] = Monitor(name, known.instance, known.numbering, lost=known.lost)
            if known.attached:
                monitor.attached, monitor.streams, monitor.clock = True, known.streams, known.clock
                monitor.expiry = loop.call_later(self._resume_within, self._expire, monitor)
                self._deliver(self.core.attach(name, monitor.streams, self._enter()))
        if self.private and not any(m.attached for m in self.monitors.values()):
            loop.call_later(self._resume_within, self._leave_empty)
        for step, gap in restored.held:
            monitor = self.monitors[step.event.monitor]
            monitor.numbering.hold(step.event.seq)
            monitor.unsettled += 1
            monitor.gaps[step.event.seq] = gap
            self._deliver(self.core.hold(step))

    def counts(self) -> Counter[str]:
        """What it has counted so far, in the order that decides, by the names of the metrics."""
        judge = next(iter(self.core.judges.values()))
        names = ("late", "skewed", "skipped", "lost", "denied")
        found = Counter({name: getattr(judge.counters, name) for name in names})
        found["duplicates"] = sum(count.duplicates for count in self.core.counts.values())
        found["refused"] = self.ledger.refused
        found["violations"] = sum(p.violations for p in judge.properties)
        found["engine_failures"] = sum(p.broken is not None for j in self.core.judges.values() for p in j.properties)
        return found

    @property
    def _takes_no_more(self) -> bool:
        return self.closing or self.clock_went_back

    def _set_time(self, wanted: Attach) -> None:
        """The first monitor says in which time a session runs. Raises a fatal `WireError` for one of another time."""
        if not self.monitors and wanted.clock == "sim":
            self.core.simulated = SimulatedTime(self.spec.by_key)
        check_time(self.id, wanted, "wall" if self.core.simulated is None else "sim")

    def _enter(self) -> int:
        """The present time, in nanoseconds; while the history can't be written, the core judges nothing."""
        self.core.suspended = self._history.failure is not None
        return self._clock.now()

    def _set_attached(self, monitor: Monitor, *, attached: bool) -> None:
        monitor.attached = attached
        record = MonitorRecord(monitor.name, monitor.instance, monitor.streams, attached, monitor.clock)
        self._history.set_monitor(self.number, record)

    def _look_who_is_back(self) -> None:
        """After a restart: hear all of whom a place was kept, once they are back or their time is over."""
        if self.core.ready_since is None and not any(m.attached and m.outbox is None for m in self.monitors.values()):
            self.core.ready_since = self._clock.now()

    def _expire(self, monitor: Monitor) -> None:
        monitor.expiry = None
        log.info("monitor did not come back", session=self.id, monitor=monitor.name)
        self._leave(monitor)

    def _leave(self, monitor: Monitor) -> None:
        if monitor.attached:
            self._set_attached(monitor, attached=False)
            self._look_who_is_back()
            self.credit.close(monitor.name)
            self._deliver(self.core.detach(monitor.name, self._enter()))
        self._leave_empty()

    def _end_if_over(self) -> None:
        if self.clock_went_back and not self.closing:
            self._on_over(self)
        self._leave_empty()

    def _leave_empty(self) -> None:
        if self.private and not self.closing and not any(m.attached for m in self.monitors.values()):
            self._on_over(self)

    def _count_again(self, monitor: Monitor, key: StreamKey) -> None:
        if key in self.spec.by_key:
            self.core.counts[monitor.name, key].duplicates += 1

    def _deliver(self, judged: list[Judged]) -> None:
        """Send the decisions at once; the history is told a little later."""
        for item in judged:
            if item.decision:
                monitor = self.monitors[item.step.event.monitor]
                seq, verdicts = item.step.event.seq, {v.property: v.outcome for v in item.verdicts}
                answer = monitor.answers[seq] = decision_frame(seq, item.decision, verdicts)
                if monitor.outbox:
                    monitor.outbox.send(answer)
                self._counters.decisions.add(self._clock.now() - item.step.event.came)
        if self.oracles is not None:
            self.oracles.ask()
        if judged:
            self.ledger.add(judged)
        for name, events in self.credit.grant(self.core.buffer):
            if outbox := self.monitors[name].outbox:
                outbox.send({"type": "credit", "events": events})
        self._arm()

    def _arm(self) -> None:
        """One timer a session, set to the earliest moment at which time alone makes something judged."""
        deadline = self.core.next_deadline
        if deadline is None or self.closing or (self._armed is not None and self._armed <= deadline):
            return
        if self._timer:
            self._timer.cancel()
        loop = asyncio.get_running_loop()
        delay = max(0, deadline - self._clock.now()) / 10**9
        self._armed, self._timer = deadline, loop.call_later(delay, self._tick)

    def _tick(self) -> None:
        self._armed = self._timer = None
        self._deliver(self.core.advance(self._enter()))
