"""What a session gives to its history, and what its monitors are told once that is committed."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import partial

from oracle_server.core.numbering import JUDGED
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged, record
from oracle_server.history.port import History
from oracle_server.history.records import Refusal, SessionRecord, stored
from oracle_server.process.clock import Clock
from oracle_server.sessions.answers import Answers
from oracle_server.sessions.commits import News
from oracle_server.sessions.counters import Counters
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.snapshots import Snapshots
from oracle_server.sessions.standing import Standing
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import VerdictsFrame, ViolationFrame
from oracle_server.wire.incoming import AnyEvent, Handling, QuickHandling

_WRITE_AFTER = 0.01
"""Seconds after a decision in which others go before the history, and what the adapter did is heard of most."""

_Used = tuple[Monitor, int, int, int]
"""A monitor's number that is used up, the gap before it, and what was lost with it if it was refused, else `JUDGED`."""


class Ledger:
    """Writes one session's steps and refusals. An ack means committed, and so does a verdict that a monitor is told."""

    def __init__(
        self, opened: SessionRecord, core: Session, history: History, clock: Clock, counters: Counters,
        monitors: Mapping[str, Monitor],
    ) -> None:  # fmt: skip
        """Write for a session that has these monitors, and those that will come."""
        self.news = News()
        """Told at each commit."""
        self.snapshots = Snapshots(opened.id, opened.number, core, history)
        self.answers = Answers(history, opened.number, [p.id for p in core.plan.spec.properties])
        self.refused = 0
        """How many events were refused."""
        self._session, self._monitors = opened.number, monitors
        self._core, self._history, self._clock, self._counters = core, history, clock, counters
        self._width = len(core.plan.spec.properties)
        self._deciding, judge = next(iter(core.judges.items()))
        self._standing = Standing(judge)
        self._position = 0
        self._unwritten: list[Judged] = []

    def resume(self, position: int, refused: int) -> None:
        """Go on with a session that was restored, and stands at a position."""
        self._position, self.refused = position, refused
        self.snapshots.resume(position)

    def add(self, judged: list[Judged]) -> None:
        """Take what was judged; it is written a little later, many steps in one go."""
        if not self._unwritten:
            asyncio.get_running_loop().call_later(_WRITE_AFTER, self.write)
        self._unwritten += judged

    def write(self) -> None:
        """Give what was judged to the history."""
        judged, self._unwritten = self._unwritten, []
        steps, used = [], []
        violations: list[ViolationFrame] = []
        for item in judged:
            self._position += 1
            event, gap, handling = item.step.event, 0, None
            if event.monitor:
                monitor = self._monitors[event.monitor]
                gap = monitor.gaps.get(event.seq, 0)
                if item.order == self._deciding:
                    monitor.gaps.pop(event.seq, None)
                    handling = monitor.handlings.pop(event.seq, None)
                    used.append((monitor, event.seq, gap, JUDGED))
            steps.append(stored(self._position, gap, item, handling))
            violations += [{"type": "violation", **record(item, v)} for v in item.verdicts if v.explanation]
        if steps:
            self._counters.judged([step.outcomes for step in steps])
            standing, position = self._standing.changed(self._last_verdict), self._position
            done = partial(self._committed, used, position, violations, standing)
            self._history.append(self._session, steps, done)
            if self.snapshots.is_due(self._position):
                self.save()

    def save(self) -> None:
        """Keep how all stands, so that a restart need not judge it all again."""
        self.write()
        self.snapshots.save(self._position, self._monitors)

    def refuse(self, monitor: Monitor, seq: int, gap: int, code: str, message: str) -> WireError:
        """Use up the number of an event, and the gap before it; the error is what its monitor is to be told."""
        self.refused += 1
        monitor.unsettled += 1
        lost = gap + (code == "bad_event")
        monitor.lost += lost
        if lost:
            self._core.note_refusal()
        refusal = Refusal(monitor.name, seq, gap, self._clock.now(), code, message)
        self._history.refuse(self._session, refusal, partial(self._settle, [(monitor, seq, gap, lost)]))
        return WireError(code, message, seq=seq)

    def amend(self, monitor: Monitor, message: Handling | QuickHandling) -> None:
        """Add what the adapter did about an event that is written already."""
        monitor.unsettled += 1
        handling = (message.passed, message.why)
        self._history.amend(self._session, monitor.name, message.seq, handling, partial(self._amended, monitor))

    def answer_again(self, monitor: Monitor, message: AnyEvent) -> None:
        """Tell a monitor what it was told, or was to be told, of an event that it sends again."""
        outbox, answer = monitor.outbox, monitor.answers.get(message.seq)
        if message.ask and outbox and answer is not None:
            outbox.send(answer)
        elif message.ask and outbox and message.seq not in monitor.gaps:
            self.answers.want(monitor, outbox, message.seq)
            return
        monitor.acknowledge()

    def follow_verdicts(self) -> None:
        """Begin to tell the monitors that want to know it how the properties stand."""
        self.write()
        self._standing.follow(self._last_verdict)

    def tell_verdicts(self, monitor: Monitor) -> None:
        """Tell a monitor that wants to know how the properties stand; to be called once its past is committed."""
        if monitor.verdicts and monitor.outbox and self._standing.committed:
            monitor.outbox.send(self._standing.committed)

    @property
    def _last_verdict(self) -> int:
        return self._position * self._width

    def _committed(
        self, used: list[_Used], position: int, violations: list[ViolationFrame], standing: VerdictsFrame | None
    ) -> None:
        self.snapshots.committed(position)
        self.news.tell()
        self._settle(used)
        for frame in violations:
            for monitor in self._monitors.values():
                if monitor.outbox:
                    monitor.outbox.send(frame)
        if standing:
            self._standing.committed = standing
            for monitor in self._monitors.values():
                self.tell_verdicts(monitor)

    def _settle(self, used: list[_Used]) -> None:
        """Acknowledge numbers that are used up in the committed history."""
        touched = {}
        for monitor, seq, gap, lost in used:
            monitor.numbering.commit(seq, gap, lost)
            monitor.unsettled -= 1
            monitor.answers.pop(seq, None)
            touched[monitor.name] = monitor
        for monitor in touched.values():
            monitor.acknowledge()
            monitor.let_go()

    def _amended(self, monitor: Monitor) -> None:
        monitor.unsettled -= 1
        monitor.let_go()
