"""A session judged again up to a place in it, one property of it by an engine that tells more of it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from functools import lru_cache, partial

from oracle_server.core.atoms import Matches
from oracle_server.core.engine import Engine
from oracle_server.core.errors import OracleError
from oracle_server.core.plan import Plan, judged_by, plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, orders
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native import engine_of
from oracle_server.engines.table import ENGINES
from oracle_server.history.port import Reading
from oracle_server.history.records import SessionRecord, SnapshotRecord, StoredStep
from oracle_server.review.beginning import begin
from oracle_server.specfiles.load import parse_spec

_PLANS = 4
"""Specs that are kept as they were read: who looks into a session asks of one verdict after another."""
GONE = "what came before it is not kept any more, so that it can't be judged again"


class NoExplanationError(OracleError):
    """A verdict can't be explained."""


class Again:
    """A session judged again, one property of it by the native engine, where that reads the same formulas."""

    def __init__(self, ready: Plan, index: int, begun: int | None) -> None:
        self.given_up = False
        """Whether the request was cancelled."""
        self._plan, self._index, self._begun = ready, index, begun
        self._core: Session
        self._recorded: list[tuple[int, Recorded]] = []

    def begin(self, snapshot: SnapshotRecord | None) -> int:
        """Begin the session, from a snapshot where it can be used; returns the position of its last step."""
        self._core, position, _ = begin(self._fresh, snapshot)
        return position

    def judge(self, steps: Sequence[StoredStep], position: int) -> None:
        """Judge the steps after a position again."""
        for expected, stored in enumerate(steps, position + 1):
            if stored.position != expected:  # they were deleted meanwhile
                raise NoExplanationError(GONE)
            if self.given_up:
                return
            self._judge(stored)
            time.sleep(0)  # yields the interpreter to the event loop

    def _judge(self, stored: StoredStep) -> None:
        self._repeat(stored)
        self._core.rejudge(stored.order, stored.step, stored.judged)

    def _repeat(self, stored: StoredStep) -> None:
        """Have the outcomes of a step repeated that are not judged again."""
        for place, engine in self._recorded:
            engine.outcome = stored.outcomes[place]

    def _fresh(self) -> Session:
        self._recorded = []
        spec = self._plan.spec
        engines = [[self._engine(i, p) for i, p in enumerate(spec.properties)] for _ in orders(spec)]
        return Session(self._plan, engines, begun=self._begun)

    def _engine(self, index: int, prop: Property) -> Engine:
        if ENGINES[prop.engine].explicable and (index == self._index or ENGINES[prop.engine].native):
            return self._chosen(prop) if index == self._index else engine_of(prop)
        engine = Recorded()
        self._recorded.append((index, engine))
        return engine

    def _chosen(self, prop: Property) -> Engine:
        """The engine of the property that it is about."""
        return engine_of(prop)


async def judge_in_thread(history: Reading, again: Again, page: Sequence[StoredStep], position: int) -> None:
    """Judge a page in a thread; where it is cancelled, wait until the thread has ended its present step."""
    thread = asyncio.ensure_future(history.in_thread(partial(again.judge, page, position)))
    try:
        await asyncio.shield(thread)
    except asyncio.CancelledError:
        again.given_up = True
        await asyncio.wait((thread,))
        raise


def plan_of(opened: SessionRecord) -> Plan:
    """The plan by which a session is judged; that of a spec of which others were asked just now is there already."""
    return judged_by(_planned(opened.text, opened.id), opened.by)


@lru_cache(maxsize=_PLANS)
def _planned(text: str, name: str) -> Plan:
    return plan(parse_spec(text, name, bounded=False).spec)


class Recorded:
    """An engine that repeats recorded outcomes."""

    def __init__(self) -> None:
        self.outcome = Outcome.UNKNOWN

    def step(self, time: int, matches: Matches) -> Outcome:  # noqa: ARG002 -- as every engine
        """The recorded outcome."""
        return self.outcome
