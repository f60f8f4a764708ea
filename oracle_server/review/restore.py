"""Bringing a session back from its history: from its last snapshot, and what its engines were fed since.

Steps that the snapshot makes needless may be gone. Where it can't be used, and they are, nothing is judged any more.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import structlog

from oracle_server.core.engine import Answer
from oracle_server.core.events import Order, Step, StreamKey
from oracle_server.core.numbering import JUDGED, Numbering
from oracle_server.core.plan import Plan
from oracle_server.core.session import Session, orders
from oracle_server.core.simulated import TimeBase
from oracle_server.engines.table import make_engines
from oracle_server.history.port import Reading
from oracle_server.history.records import MonitorRecord, Refusal, SnapshotRecord, StoredStep
from oracle_server.review.beginning import begin

_ONCE = "was asked before the server was restarted"

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class KnownMonitor:
    """A monitor as it was; `lost` are events that no judged event has reported yet."""

    instance: str
    streams: tuple[StreamKey, ...]
    attached: bool
    clock: TimeBase
    numbering: Numbering
    lost: int


@dataclass(frozen=True, slots=True)
class Restored:
    """Where a session stood: its judge's state, what was judged, its monitors, and what was still held.

    `held` are events with the gaps before them that were judged by arrival, and not yet by publication.
    """

    core: Session
    position: int
    refused: int
    monitors: dict[str, KnownMonitor]
    held: list[tuple[Step, int]]


_Used = tuple[int, int, int]
"""A number that is used up, the gap before it, and what was lost with it where it was refused, else `JUDGED`."""


async def restore(history: Reading, session: int, plan: Plan) -> Restored:
    """Go on from a session's last snapshot, and judge the steps after it again. Raises `HistoryError`."""
    snapshot = await history.snapshot(session)
    core, position = await _begin(history, session, plan, snapshot)
    again = _Rejudging(core, plan)
    async for page in history.steps(session, snapshot.settled if snapshot else 0, position):
        again.use(page)
    async for page in history.steps(session, position):
        await asyncio.to_thread(again.judge, page)
        position = page[-1].position
    if again.differing:
        log.error("restored verdicts differ from the recorded ones", session=session, steps=again.differing)
    refused = await history.refusals(session)
    for refusal in refused:
        again.refuse(refusal)
    numbers = (snapshot and snapshot.numbers) or {}
    monitors = {
        monitor.name: _known(monitor, Numbering(again.used[monitor.name], numbers.get(monitor.name)))
        for monitor in await history.monitors(session)
    }
    return Restored(core, position, len(refused), monitors, [*again.waiting.values()])


async def _begin(history: Reading, session: int, plan: Plan, snapshot: SnapshotRecord | None) -> tuple[Session, int]:
    """The session to go on with, and the position of the last step before.

    A new one where its snapshot can't be used; and where the first steps are gone too, one that judges no more.
    """
    core, position, problem = await asyncio.to_thread(begin, lambda: Session(plan, make_engines(plan)), snapshot)
    if position:
        return core, position
    if snapshot is not None:
        log.warning("all of a session is judged again", session=session, reason=problem)
    first, _ = await history.extent(session)
    if first > 1:
        n = (first - 1) * len(plan.spec.properties) + 1
        core.give_up(n, f"its beginning is not kept any more, and {problem}")
        log.error("a session can't be judged any more", session=session, reason=problem)
    return core, first - 1


class _Rejudging:
    """Judges a session's steps again, in their sequence, and finds which numbers are used up and what was held."""

    def __init__(self, core: Session, plan: Plan) -> None:
        self.used: defaultdict[str, list[_Used]] = defaultdict(list)
        self.waiting: dict[tuple[str, int], tuple[Step, int]] = {}
        self.differing = 0
        """Steps of which other verdicts are recorded."""
        self._core, self._plan, self._deciding = core, plan, orders(plan.spec)[0]

    def use(self, steps: Sequence[StoredStep]) -> None:
        """Know the numbers of steps that are not judged again."""
        for stored in steps:
            if not stored.is_tick:
                event = stored.step.event
                self.used[event.monitor].append((event.seq, stored.gap, JUDGED))

    def judge(self, steps: Sequence[StoredStep]) -> None:
        """Judge recorded steps again."""
        for stored in steps:
            self._judge(stored)

    def refuse(self, refusal: Refusal) -> None:
        """Take in a refusal."""
        lost = refusal.gap + (refusal.code == "bad_event")
        self.used[refusal.monitor].append((refusal.seq, refusal.gap, lost))
        if lost:
            self._core.note_refusal()

    def _judge(self, stored: StoredStep) -> None:
        order, step, outcomes, degraded = stored.order, stored.step, stored.outcomes, stored.degraded
        if all(degraded):  # by a loss that was known before its event was judged
            self._core.judges[order].degrade()
        if not stored.is_tick and not step.skipped:
            asked = self._plan.streams[step.event.stream].asked
            self._core.receive(order, {i: Answer(outcomes[i], _ONCE, degraded[i]) for i in asked})
        judged = self._core.rejudge(order, step, stored.judged)
        self.differing += tuple([v.outcome for v in judged.verdicts] if judged else ()) != outcomes
        if not stored.is_tick:
            self._settle(order, step, stored.gap)

    def _settle(self, order: Order, step: Step, gap: int) -> None:
        monitor, seq = step.event.monitor, step.event.seq
        if order == self._deciding:
            self.waiting.pop((monitor, seq), None)
            self.used[monitor].append((seq, gap, JUDGED))
        else:
            self.waiting[monitor, seq] = step, gap


def _known(monitor: MonitorRecord, numbering: Numbering) -> KnownMonitor:
    return KnownMonitor(monitor.instance, monitor.streams, monitor.attached, monitor.clock, numbering, numbering.lost)
