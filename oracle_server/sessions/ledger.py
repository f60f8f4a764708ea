"""What a session writes to its history, and what it sends to its monitors once that is committed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from functools import partial

import structlog

from oracle_server.core.ordering.numbering import JUDGED
from oracle_server.core.revisions import Revision
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged
from oracle_server.core.weakly import weakly
from oracle_server.history.episodes import going_on, stored_episodes
from oracle_server.history.port import History
from oracle_server.history.records import (
    MonitorRecord,
    Refusal,
    SessionRecord,
    StoredStep,
    stored,
    stored_revision,
)
from oracle_server.process.clock import Clock
from oracle_server.review.restore import Restored
from oracle_server.sessions.alarms import Alarm, SessionAlarms
from oracle_server.sessions.backlog import Backlog
from oracle_server.sessions.commits import Commits
from oracle_server.sessions.counters import Counters
from oracle_server.sessions.episodes import EpisodeFeed, ended_frames, episode_frames
from oracle_server.sessions.lookup import DecisionLookup
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.shares import Share
from oracle_server.sessions.snapshots import Snapshots
from oracle_server.sessions.standing import Standing
from oracle_server.sessions.telling import News, for_log, news, tell
from oracle_server.sessions.violations import ViolationLog
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import EpisodeFrame, VerdictsFrame
from oracle_server.wire.incoming import AnyEvent, Handling, QuickHandling

_WRITE_AFTER = 0.01
"""Seconds from a step to its writing: decisions have priority, and most adapters report their handling meanwhile."""

log = structlog.get_logger()

_Used = tuple[Monitor, int, int, int]
"""A monitor's number that is used up, the gap before it, and what was lost with it if it was refused, else `JUDGED`."""


class Ledger:
    """Writes one session's steps and refusals. Acks and verdicts are sent to monitors only after their commit."""

    def __init__(
        self, opened: SessionRecord, core: Session, history: History, clock: Clock, counters: Counters,
        backlog: Backlog, share: Share, monitors: Mapping[str, Monitor], arm: Callable[[], None],
    ) -> None:  # fmt: skip
        """Write for a session; `monitors` is the session's own mapping, to which later monitors are added.

        It calls `arm` where the session may be due earlier than it was.
        """
        self._arm = arm
        self.commits = Commits()
        self.snapshots = Snapshots(
            opened.id, opened.number, core, history, backlog, partial(share.run_for_server, weakly(self.save))
        )
        self.lookup = DecisionLookup(history, opened.number, [p.id for p in core.plan.spec.properties])
        self.alarms: SessionAlarms | None = None
        """Who is told of violations beside monitors; None where nobody is."""
        self.episodes = EpisodeFeed()
        """What was committed of episodes."""
        self.refused = 0
        """How many events were refused."""
        self._session, self._monitors, self._share = opened.number, monitors, share
        self._record = opened
        self._core, self._history, self._clock, self._counters = core, history, clock, counters
        self._spec, self._names = opened.spec, tuple(p.id for p in core.plan.spec.properties)
        self._width = len(self._names)
        self._deciding = next(iter(core.judges))
        self._standing = Standing(core)
        self._violations = ViolationLog(opened.id, clock)
        self._position = 0
        self._unwritten: list[Judged] = []
        self._timer: asyncio.TimerHandle | None = None

    def resume(self, restored: Restored) -> None:
        """Continue a restored session where it was."""
        self._position, self.refused = restored.position, restored.refused
        self.snapshots.resume(restored.position, restored.saved)
        known = going_on(self._core.judges, self._names)
        if known:  # they are as they were, unless the server was stopped between two commits, or is a newer version
            self._history.append(self._session, (), _nothing, (), known)

    def end(self) -> None:
        """Write what is left; episodes end with the session, which is told once it is committed, as all else."""
        self.write()
        if self._timer is not None and not self._unwritten:
            self._timer.cancel()  # else it would keep the session alive
        ended = going_on(self._core.judges, self._names, closed=True)
        frames, standing = ended_frames(self._record, self._core.judges), self._standing.ended(self._last_verdict)
        done = partial(self._share.run, self._committed, [], self._position, [], frames, standing, [])
        if frames:
            self._history.append(self._session, (), done, (), ended)

    def add(self, judged: list[Judged]) -> None:
        """Queue judged steps; many are written together, within `_WRITE_AFTER`, and all of one call are."""
        if not self._unwritten:
            self._write_soon()
        self._unwritten += judged

    def _write_soon(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(_WRITE_AFTER, self._share.run, self.write)

    def write(self) -> None:
        """Write all queued steps to the history; where that fails, nothing more of the session is kept."""
        judged, self._unwritten = self._whole()
        if self._unwritten:
            self._write_soon()
        if not judged:
            return
        try:
            self._write(judged)
        except Exception as error:
            log.exception("judged steps can't be told to the history", session=self._session)
            self._history.stop(self._session, f"{type(error).__name__}: {error}")  # later ones would leave a gap
        else:
            if self.snapshots.is_due(self._position):
                self._share.run_for_server(self.save)

    def restate(self, monitor: MonitorRecord) -> None:
        """Write what a monitor reports of its streams, and send how the properties then stand."""
        self.write()
        standing = self._standing.changed(self._last_verdict)
        self._history.set_monitor(self._session, monitor, partial(self._announce, standing))

    def save(self) -> None:
        """Take a snapshot, so that a restart judges only later steps again."""
        self.write()
        if self._unwritten:  # the core is further than what is written: at a later write
            return
        self.snapshots.save(self._position, self._monitors)
        self._arm()

    def refuse(self, monitor: Monitor, seq: int, gap: int, code: str, message: str) -> WireError:
        """Record the refusal of an event, which uses up its number and the gap before it.

        Returns the error to send to the monitor.
        """
        self.refused += 1
        monitor.unsettled += 1
        lost = gap + (code == "bad_event")
        monitor.lost += lost
        if lost:
            self._core.note_loss()
        refusal = Refusal(monitor.name, seq, gap, self._clock.now(), code, message)
        self._history.refuse(self._session, refusal, partial(self._settle, [(monitor, seq, gap, lost)]))
        return WireError(code, message, seq=seq)

    def amend(self, monitor: Monitor, message: Handling | QuickHandling) -> None:
        """Record what the adapter did with an event that is already written."""
        monitor.unsettled += 1
        handling = (message.passed, message.why)
        self._history.amend(self._session, monitor.name, message.seq, handling, partial(self._amended, monitor))

    def answer_duplicate(self, monitor: Monitor, message: AnyEvent) -> None:
        """Send the decision on an event that was received before, and acknowledge it where it is committed.

        Raises `WireError` where another process of the monitor's name has sent that one.
        """
        if message.seq < monitor.first:
            self.refused += 1
            monitor.lost += 1
            self._core.note_loss()
            why = f"{message.seq} is the number of an event of another process: go on at `next`, {monitor.first}"
            raise WireError("bad_seq", why, seq=message.seq)
        outbox, decision = monitor.outbox, monitor.decisions.get(message.seq)
        if message.ask and outbox and decision is not None:
            outbox.send(decision)
        elif message.ask and outbox and message.seq not in monitor.gaps:
            self.lookup.request(monitor, outbox, message.seq)
            return
        monitor.acknowledge()

    def follow_verdicts(self) -> None:
        """Begin to send `verdicts` frames to the monitors that requested them."""
        self.write()
        self._standing.follow(self._last_verdict)

    def send_verdicts(self, monitor: Monitor) -> None:
        """Send the last committed `verdicts` frame to a monitor, if it requested these frames."""
        if monitor.verdicts and monitor.outbox and self._standing.committed:
            monitor.outbox.send(self._standing.committed)

    def _write(self, judged: list[Judged]) -> None:
        used: list[_Used] = []
        steps = [self._stored(item, used) for item in judged]
        told = [frame for item in judged for frame in news(item)]
        self._counters.violated.add(self._spec, told, self._deciding)
        self._counters.add_steps([step.outcomes for step in steps if step.revision is None])
        standing, position = self._standing.changed(self._last_verdict), self._position
        alarms = self.alarms.look(judged) if self.alarms else []
        pairs = [(item, step.explanations) for item, step in zip(judged, steps, strict=True) if item.episodes]
        followed = [frame for item, why in pairs for frame in episode_frames(self._record, item, why)]
        done = partial(self._share.run, self._committed, used, position, told, followed, standing, alarms)
        revisions = [item for item in judged if isinstance(item, Revision)]
        episodes = [e for item, why in pairs for e in stored_episodes(item, self._names, why)]
        self._history.append(self._session, steps, done, revisions, episodes)

    def _stored(self, item: Judged, used: list[_Used]) -> StoredStep:
        """The next row, and in `used` the number that its event uses up."""
        self._position += 1
        if isinstance(item, Revision):
            return stored_revision(self._position, item)
        event, gap, handling = item.step.event, 0, None
        if event.monitor:
            monitor = self._monitors[event.monitor]
            gap = monitor.gaps.get(event.seq, 0)
            if item.order == self._deciding and not event.more:
                monitor.gaps.pop(event.seq, None)
                handling = monitor.handlings.pop(event.seq, None)
                used.append((monitor, event.seq, gap, JUDGED))
        return stored(self._position, gap, item, handling)

    def _whole(self) -> tuple[list[Judged], list[Judged]]:
        """The queued steps, and behind them those that wait for the other rows of their event.

        All rows of an event are in one transaction: one of which a part is kept would be taken for used up.
        """
        judged, first = self._unwritten, dict[tuple[str, str, int], int]()
        for i, item in enumerate(judged):
            event = item.step.event
            if event.more:
                first.setdefault((item.order, event.monitor, event.seq), i)
            elif event.row:
                first.pop((item.order, event.monitor, event.seq), None)
        whole = min(first.values(), default=len(judged))
        return judged[:whole], judged[whole:]

    @property
    def _last_verdict(self) -> int:
        return self._position * self._width

    def _committed(
        self, used: list[_Used], position: int, told: list[News], episodes: list[EpisodeFrame],
        standing: VerdictsFrame | None, alarms: list[Alarm],
    ) -> None:  # fmt: skip
        self.snapshots.committed(position)
        self.episodes.add(episodes)
        self.commits.notify()
        settled = self._acknowledge(used)
        self._violations.add(for_log(told))
        tell(self._monitors.values(), told, episodes)
        if self.alarms:
            self.alarms.send(alarms)
        self._announce(standing)
        for monitor in settled:
            monitor.confirm_detach()  # behind what it is told: it hears nothing more

    def _announce(self, standing: VerdictsFrame | None) -> None:
        if standing:
            self._standing.committed = standing
            for monitor in self._monitors.values():
                self.send_verdicts(monitor)

    def _settle(self, used: list[_Used]) -> None:
        """Acknowledge numbers that are used up in the committed history, and let monitors go that wait for that."""
        for monitor in self._acknowledge(used):
            monitor.confirm_detach()

    def _acknowledge(self, used: list[_Used]) -> list[Monitor]:
        """Acknowledge numbers that are used up in the committed history; returns whose they are."""
        touched = {}
        for monitor, seq, gap, lost in used:
            monitor.numbering.commit(seq, gap, lost)
            monitor.unsettled -= 1
            monitor.decisions.pop(seq, None)
            touched[monitor.name] = monitor
        for monitor in touched.values():
            monitor.acknowledge()
        return [*touched.values()]

    def _amended(self, monitor: Monitor) -> None:
        monitor.unsettled -= 1
        monitor.confirm_detach()


def _nothing() -> None:
    """There is nothing to do once it is committed."""
