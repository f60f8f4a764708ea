"""Bringing a session back from its history: from its last snapshot, and what its engines were fed since."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import structlog

from oracle_server.core.errors import EngineError
from oracle_server.core.events import Step, StreamKey
from oracle_server.core.plan import Plan
from oracle_server.core.session import Session, orders
from oracle_server.engines.choice import make_engines
from oracle_server.numbering import Numbering
from oracle_server.protocol import TimeBase
from oracle_server.schema import LETTERS, STEP_COLUMNS, Row, step_of
from oracle_server.store import Store

_PAGE = 5_000

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Known:
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
    monitors: dict[str, Known]
    held: list[tuple[Step, int]]


@dataclass(frozen=True, slots=True)
class _Used:
    """A number that is used up, with the gap before it; `lost` counts what a refusal withheld from the judge."""

    seq: int
    gap: int
    lost: int | None = None


def restore(store: Store, number: int, plan: Plan) -> Restored:
    """Go on from a session's last snapshot, and judge the steps after it again: call it off the event loop."""
    core, position = _from_snapshot(store, number, plan)
    primary = orders(plan.spec)[0]
    used: dict[str, list[_Used]] = {}
    waiting: dict[tuple[str, int], Step] = {}
    differing = 0
    sql = "SELECT monitor, seq, gap FROM steps WHERE session = ? AND position <= ? AND kind != 'tick'"
    for monitor, seq, gap in store.read(sql, (number, position)):
        used.setdefault(monitor, []).append(_Used(seq, gap))
    outcomes, gaps = STEP_COLUMNS.index("outcomes"), STEP_COLUMNS.index("gap")
    select = f"SELECT {','.join(STEP_COLUMNS)} FROM steps WHERE session = ? AND position > ? ORDER BY position LIMIT ?"  # noqa: S608
    while rows := store.read(select, (number, position, _PAGE)):
        for row in rows:
            order, step, judged_at = step_of(row)
            judged = core.rejudge(order, step, judged_at)
            verdicts = judged.verdicts if judged else ()
            differing += "".join(LETTERS[v.outcome] for v in verdicts) != row[outcomes]
            if step.event.stream.kind == "tick":
                continue
            key = (step.event.monitor, step.event.seq)
            if order == primary:
                waiting.pop(key, None)
                used.setdefault(step.event.monitor, []).append(_Used(step.event.seq, row[gaps]))
            else:
                waiting[key] = step
        position += len(rows)
    if differing:
        log.error("restored verdicts differ from the recorded ones", session=number, steps=differing)
    refused = store.read("SELECT monitor, seq, gap, code FROM refused WHERE session = ?", (number,))
    for monitor, seq, gap, code in refused:
        used.setdefault(monitor, []).append(_Used(seq, gap, gap + (code == "bad_event")))
    rows = store.read("SELECT name, instance, streams, attached, clock FROM monitors WHERE session = ?", (number,))
    monitors = {name: _known(tuple(known), used.get(name, [])) for name, *known in rows}
    return Restored(core, position, len(refused), monitors, [(step, 0) for step in waiting.values()])


def _from_snapshot(store: Store, number: int, plan: Plan) -> tuple[Session, int]:
    """The session as it was saved, and the position of the last step before; a new one where that can't be used."""
    saved = store.read("SELECT position, data FROM snapshots WHERE session = ?", (number,))
    if saved:
        position, data = saved[0]
        core = Session(plan, make_engines(plan))
        try:
            core.restore(msgspec.json.decode(data), position * len(plan.spec.properties) + 1)
        except (EngineError, KeyError, TypeError, ValueError) as error:
            log.warning("a snapshot can't be used, so that all is judged again", session=number, reason=str(error))
        else:
            return core, position
    return Session(plan, make_engines(plan)), 0


def _known(row: Row, used: list[_Used]) -> Known:
    instance, streams, attached, clock = row
    used.sort(key=lambda u: u.seq)
    lost = before = 0
    for item in used:
        if item.lost is not None:
            lost += item.lost
        elif item.seq - item.gap == before + 1:
            lost = 0  # told with this event, which came next
        before = item.seq
    claimed = tuple(StreamKey(*key) for key in msgspec.json.decode(streams))
    return Known(instance, claimed, bool(attached), clock, Numbering([(u.seq, u.gap) for u in used]), lost)
