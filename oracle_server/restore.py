"""Bringing a session back from its history: its engines are fed what they were fed before."""

from __future__ import annotations

from dataclasses import dataclass

import structlog

from oracle_server.core.events import Step
from oracle_server.core.plan import Plan
from oracle_server.core.session import Session, orders
from oracle_server.engines.choice import make_engines
from oracle_server.numbering import Numbering
from oracle_server.schema import LETTERS, STEP_COLUMNS, step_of
from oracle_server.store import Store

_PAGE = 5_000

log = structlog.get_logger()


@dataclass(frozen=True, slots=True)
class Restored:
    """Where a session stood: its judge's state, what was judged, each monitor's numbers, and what was still held.

    `held` are events with the gaps before them that were judged by arrival, and not yet by publication.
    """

    core: Session
    position: int
    refused: int
    numberings: dict[str, Numbering]
    held: list[tuple[Step, int]]


def restore(store: Store, number: int, plan: Plan) -> Restored:
    """Judge a session's stored steps again. Takes as long as judging them did: call it off the event loop."""
    core = Session(plan, make_engines(plan))
    primary = orders(plan.spec)[0]
    used: dict[str, list[tuple[int, int]]] = {}
    waiting: dict[tuple[str, int], Step] = {}
    position = differing = 0
    outcomes, gaps = STEP_COLUMNS.index("outcomes"), STEP_COLUMNS.index("gap")
    select = f"SELECT {','.join(STEP_COLUMNS)} FROM steps WHERE session = ? AND position > ? ORDER BY position LIMIT ?"  # noqa: S608
    while rows := store.read(select, (number, position, _PAGE)):
        for row in rows:
            order, step, judged_at = step_of(row)
            judged = core.rejudge(order, step, judged_at)
            differing += "".join(LETTERS[v.outcome] for v in judged.verdicts) != row[outcomes]
            key = (step.event.monitor, step.event.seq)
            if order == primary:
                waiting.pop(key, None)
                used.setdefault(step.event.monitor, []).append((step.event.seq, row[gaps]))
            else:
                waiting[key] = step
        position += len(rows)
    if differing:
        log.error("restored verdicts differ from the recorded ones", session=number, steps=differing)
    refused = store.read("SELECT monitor, seq, gap FROM refused WHERE session = ?", (number,))
    for monitor, seq, gap in refused:
        used.setdefault(monitor, []).append((seq, gap))
    for monitor, _ in waiting:
        used.setdefault(monitor, [])
    numberings = {monitor: Numbering(sorted(numbers)) for monitor, numbers in used.items()}
    return Restored(core, position, len(refused), numberings, [(step, 0) for step in waiting.values()])
