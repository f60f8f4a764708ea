"""Bringing a session back from its history: from its last snapshot, and what its engines were fed since.

Steps that the snapshot makes needless may be gone. Where it can't be used, and they are, nothing is judged any more.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import structlog

from oracle_server.core.engine import Answer
from oracle_server.core.errors import EngineError
from oracle_server.core.events import Order, Step, StreamKey
from oracle_server.core.numbering import JUDGED, Numbering
from oracle_server.core.plan import Plan
from oracle_server.core.session import Session, orders
from oracle_server.core.simulated import TimeBase
from oracle_server.engines.table import make_engines
from oracle_server.history.sqlite.schema import LETTERS, OUTCOMES, STEP_COLUMNS, Row, step_of
from oracle_server.history.sqlite.store import Store

_PAGE = 5_000
_ONCE = "was asked before the server was restarted"

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class KnownMonitor:
    """A monitor as it was; `lost` are events that were not told yet with one that was judged."""

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


class _Saved(NamedTuple):
    """A session's snapshot: after which step it was taken, and the monitors' numbers as of an earlier step."""

    position: int = 0
    data: str | None = None
    settled: int = 0
    numbers: str | None = None


_OUTCOMES, _GAP, _DEGRADED = (STEP_COLUMNS.index(name) for name in ("outcomes", "gap", "degraded"))

_Used = tuple[int, int, int]
"""A number that is used up, the gap before it, and what was lost with it where it was refused, else `JUDGED`."""


def restore(store: Store, number: int, plan: Plan) -> Restored:
    """Go on from a session's last snapshot, and judge the steps after it again: call it off the event loop."""
    saved = _saved(store, number)
    core, position = _begin(store, number, plan, saved)
    again = _Rejudging(core, plan)
    sql = "SELECT monitor, seq, gap FROM steps WHERE session = ? AND position > ? AND position <= ? AND kind != 'tick'"
    for monitor, seq, gap in store.read(sql, (number, saved.settled, position)):
        again.used[monitor].append((seq, gap, JUDGED))
    select = f"SELECT {','.join(STEP_COLUMNS)} FROM steps WHERE session = ? AND position > ? ORDER BY position LIMIT ?"  # noqa: S608
    while rows := store.read(select, (number, position, _PAGE)):
        for row in rows:
            again.judge(row)
        position += len(rows)
    if again.differing:
        log.error("restored verdicts differ from the recorded ones", session=number, steps=again.differing)
    refused = store.read("SELECT monitor, seq, gap, code FROM refused WHERE session = ?", (number,))
    for monitor, seq, gap, code in refused:
        again.refuse(monitor, seq, gap, code)
    rows = store.read("SELECT name, instance, streams, attached, clock FROM monitors WHERE session = ?", (number,))
    numbers: dict[str, Any] = msgspec.json.decode(saved.numbers) if saved.numbers else {}
    monitors = {name: _known(tuple(it), Numbering(again.used[name], numbers.get(name))) for name, *it in rows}
    return Restored(core, position, len(refused), monitors, [*again.waiting.values()])


class _Rejudging:
    """Judges a session's steps again, in their sequence, and finds which numbers are used up and what was held."""

    def __init__(self, core: Session, plan: Plan) -> None:
        self.used: defaultdict[str, list[_Used]] = defaultdict(list)
        self.waiting: dict[tuple[str, int], tuple[Step, int]] = {}
        self.differing = 0
        """Steps of which other verdicts are recorded."""
        self._core, self._plan, self._deciding = core, plan, orders(plan.spec)[0]

    def judge(self, row: Row) -> None:
        """Judge a recorded step again."""
        order, step, judged_at = step_of(row)
        outcomes, degraded = row[_OUTCOMES], row[_DEGRADED]
        if "0" not in degraded:  # by a loss that was known before its event was judged
            self._core.judges[order].degrade()
        tick = step.event.stream.kind == "tick"
        if not tick and not step.skipped:
            heard = self._plan.streams[step.event.stream].asked
            self._core.receive(order, {i: Answer(OUTCOMES[outcomes[i]], _ONCE, degraded[i] == "1") for i in heard})
        judged = self._core.rejudge(order, step, judged_at)
        verdicts = judged.verdicts if judged else ()
        self.differing += "".join(LETTERS[v.outcome] for v in verdicts) != outcomes
        if not tick:
            self._settle(order, step, row[_GAP])

    def refuse(self, monitor: str, seq: int, gap: int, code: str) -> None:
        """Take in a refusal."""
        lost = gap + (code == "bad_event")
        self.used[monitor].append((seq, gap, lost))
        if lost:
            self._core.note_refusal()

    def _settle(self, order: Order, step: Step, gap: int) -> None:
        monitor, seq = step.event.monitor, step.event.seq
        if order == self._deciding:
            self.waiting.pop((monitor, seq), None)
            self.used[monitor].append((seq, gap, JUDGED))
        else:
            self.waiting[monitor, seq] = step, gap


def _saved(store: Store, number: int) -> _Saved:
    rows = store.read("SELECT position, data, settled, numbers FROM snapshots WHERE session = ?", (number,))
    return _Saved(*rows[0]) if rows else _Saved()


def _begin(store: Store, number: int, plan: Plan, saved: _Saved) -> tuple[Session, int]:
    """The session as it was saved, and the position of the last step before.

    A new one where it can't be used; and where the first steps are gone too, one that judges no more.
    """
    width = len(plan.spec.properties)
    core, problem = Session(plan, make_engines(plan)), "it has no snapshot"
    if saved.data is not None:
        try:
            core.restore(msgspec.json.decode(saved.data), saved.position * width + 1)
        except (EngineError, KeyError, TypeError, ValueError) as error:
            core, problem = Session(plan, make_engines(plan)), str(error)
            log.warning("a snapshot can't be used, so that all is judged again", session=number, reason=problem)
        else:
            return core, saved.position
    first = store.read("SELECT min(position) FROM steps WHERE session = ?", (number,))[0][0] or 1
    if first > 1:
        core.give_up(
            (first - 1) * width + 1, f"its beginning is not kept any more, and its snapshot is of no use: {problem}"
        )
        log.error("a session can't be judged any more", session=number, reason=problem)
    return core, first - 1


def _known(row: Row, numbering: Numbering) -> KnownMonitor:
    instance, streams, attached, clock = row
    claimed = tuple(StreamKey(*key) for key in msgspec.json.decode(streams))
    return KnownMonitor(instance, claimed, bool(attached), clock, numbering, numbering.lost)
