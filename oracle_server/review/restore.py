"""Restoring a session from its history: from its last snapshot, by judging the steps after it again.

Steps before the snapshot may be deleted. If they are, and the snapshot can't be used, nothing is judged any more.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import structlog

from oracle_server.core.bypass import Bypass
from oracle_server.core.engine import Answer
from oracle_server.core.events import Order, Step, StreamKey, TimeBase
from oracle_server.core.ordering.numbering import JUDGED, Numbering
from oracle_server.core.plan import Plan
from oracle_server.core.revise.kept import MOST
from oracle_server.core.session import Session
from oracle_server.core.spec import orders
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.table import make_engines
from oracle_server.history.port import Reading
from oracle_server.history.records import MonitorRecord, Refusal, SnapshotRecord, StoredStep, recorded
from oracle_server.review.beginning import begin
from oracle_server.review.episodes import find_episodes, knows_episodes

_ONCE = "was asked before the server was restarted"

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class KnownMonitor:
    """A restored monitor; `lost` is its number of lost events that no judged event has reported yet."""

    instance: str
    streams: tuple[StreamKey, ...]
    attached: bool
    clock: TimeBase
    numbering: Numbering
    lost: int
    bypasses: Mapping[StreamKey, Bypass]
    left: int | None


@dataclass(frozen=True, slots=True)
class Restored:
    """A restored session: its core, the position of its last step, its refusals, monitors and held events.

    `saved` is the position of its snapshot, 0 where none could be used. `held` are the events that were judged by
    arrival and not yet by publication, with the gaps before them.
    """

    core: Session
    position: int
    saved: int
    refused: int
    monitors: dict[str, KnownMonitor]
    held: list[tuple[Step, int]]


_Used = tuple[int, int, int]
"""A number that is used up, the gap before it, and what was lost with it where it was refused, else `JUDGED`."""


async def restore(history: Reading, session: int, plan: Plan) -> Restored:
    """Restore a session from its last snapshot, and judge the steps after it again. Raises `HistoryError`."""
    snapshot = await history.snapshot(session)
    begun = await _begun(history, session, snapshot)
    core, position = await _begin(history, session, plan, snapshot, begun)
    again, saved = _Rejudging(core, plan), position
    async for page in history.steps(session, snapshot.settled if snapshot else 0, position):
        again.use(page)
    async for page in history.steps(session, position):
        await asyncio.to_thread(again.judge, page)
        position = page[-1].position
    await asyncio.to_thread(core.finish_again)
    for judge in core.judges.values():
        judge.bypass(())  # what is bypassed now is known of the monitors
    if saved and not knows_episodes(snapshot):
        await find_episodes(history, session, core)
    if again.differing:
        log.error("restored verdicts differ from the recorded ones", session=session, steps=again.differing)
    numbers, known = (snapshot and snapshot.numbers) or {}, await history.monitors(session)
    saved_numbers = numbers if saved else {}  # the snapshot knows of what was refused up to these
    after = {monitor.name: Numbering((), saved_numbers.get(monitor.name)).upto for monitor in known}
    for refusal in await history.refusals(session, after):
        again.refuse(refusal)
    monitors = {
        monitor.name: _known(monitor, Numbering(again.used[monitor.name], numbers.get(monitor.name)))
        for monitor in known
    }
    if any(monitor.lost for monitor in monitors.values()):
        core.note_loss()  # what was refused may be deleted, and the snapshot that knew of it be of no use
    return Restored(core, position, saved, await history.refused(session), monitors, [*again.waiting.values()])


async def _begun(history: Reading, session: int, snapshot: SnapshotRecord | None) -> int | None:
    """When a session began; one that an older version judged, without any grace, began long ago."""
    opened = await history.session(session)
    if opened is not None and opened.begun is not None:
        return opened.begun
    first, last = await history.extent(session)
    return 0 if snapshot is not None or first <= last else None


async def _begin(
    history: Reading, session: int, plan: Plan, snapshot: SnapshotRecord | None, begun: int | None
) -> tuple[Session, int]:
    """The session to continue with, and the position of its last step.

    It is a fresh one where the snapshot can't be used, and one that judges nothing where the first steps are deleted.
    """
    core, position, problem = await asyncio.to_thread(
        begin, lambda: Session(plan, make_engines(plan), begun=begun), snapshot
    )
    if position:
        return core, position
    if snapshot is not None and problem:  # none where nothing was judged
        log.warning("all of a session is judged again", session=session, reason=problem)
    first, _ = await history.extent(session)
    if first > 1:
        n = (first - 1) * len(plan.spec.properties) + 1
        core.give_up(n, f"its beginning is not kept any more, and {problem}")
        log.error("a session can't be judged any more", session=session, reason=problem)
    return core, first - 1


class _Rejudging:
    """Judges a session's steps again, and collects the used numbers of its monitors and the held events."""

    def __init__(self, core: Session, plan: Plan) -> None:
        self.used: defaultdict[str, list[_Used]] = defaultdict(list)
        self.waiting: dict[tuple[str, int, int | None], tuple[Step, int]] = {}
        self._differing = 0
        self._last: deque[StoredStep] = deque(maxlen=MOST)
        """The last rows of a session that revises, which may be among those that it keeps."""
        self._names = tuple(prop.id for prop in plan.spec.properties)
        self._core, self._plan, self._deciding = core, plan, orders(plan.spec)[0]

    @property
    def differing(self) -> int:
        """How many steps have other outcomes than recorded; where the spec revises, of those that may still change."""
        if self._core.lateness is None:
            return self._differing
        rows = {row.position: row.judged for row in self._core.lateness.judge.keeping}
        recorded = ((stored.position, _outcomes(stored)) for stored in self._last if stored.position in rows)
        return sum([v.outcome.current for v in rows[at].verdicts] != outcomes for at, outcomes in recorded)

    def use(self, steps: Sequence[StoredStep]) -> None:
        """Mark the numbers of steps that are not judged again as used."""
        for stored in steps:
            if stored.step.event.monitor:
                event = stored.step.event
                self.used[event.monitor].append((event.seq, stored.gap, JUDGED))

    def judge(self, steps: Sequence[StoredStep]) -> None:
        """Judge recorded steps again."""
        for stored in steps:
            self._judge(stored)

    def refuse(self, refusal: Refusal) -> None:
        """Mark the number of a refused event as used."""
        lost = refusal.gap + (refusal.code == "bad_event")
        self.used[refusal.monitor].append((refusal.seq, refusal.gap, lost))
        if lost:
            self._core.note_loss()

    def _judge(self, stored: StoredStep) -> None:
        if stored.revision is not None:
            self._core.rejudge_row(recorded(stored, self._names), stored.position)
            return
        order, step, outcomes, degraded = stored.order, stored.step, stored.outcomes, stored.degraded
        if stored.lost:  # a loss was known before the event was judged
            self._core.judges[order].degrade()
        self._core.judges[order].bypass(stored.bypassed)
        if not stored.is_tick and not step.skipped:
            asked = self._plan.streams[step.event.stream].asked
            self._core.receive(order, {i: Answer(outcomes[i], _ONCE, degraded[i]) for i in asked})
        if self._core.lateness is not None:
            self._core.rejudge_row(recorded(stored, self._names), stored.position)
            self._last.append(stored)
        else:
            judged = self._core.rejudge(order, step, stored.judged)
            self._differing += tuple([v.outcome for v in judged.verdicts] if judged else ()) != outcomes
        if not stored.is_tick:
            self._settle(order, step, stored.gap)

    def _settle(self, order: Order, step: Step, gap: int) -> None:
        monitor, seq, row = step.event.monitor, step.event.seq, step.event.row
        if order == self._deciding:
            self.waiting.pop((monitor, seq, row), None)
            self.used[monitor].append((seq, gap, JUDGED))
        else:
            self.waiting[monitor, seq, row] = step, gap


def _outcomes(stored: StoredStep) -> list[Outcome | None]:
    """The outcomes that stand, none of them final: that is said later."""
    outcomes = stored.outcomes if stored.standing is None else stored.standing.outcomes
    return [outcome and outcome.current for outcome in outcomes]


def _known(monitor: MonitorRecord, numbering: Numbering) -> KnownMonitor:
    return KnownMonitor(
        monitor.instance, monitor.streams, monitor.attached, monitor.clock, numbering, numbering.lost,
        monitor.bypasses, monitor.left,
    )  # fmt: skip
