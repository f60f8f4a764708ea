"""A session that judges a random case, and is stopped and restored at some places; its rows are read plainly."""

from __future__ import annotations

import json
import random
from collections import Counter

import msgspec

from oracle_server.core.events import Event, Order
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import orders
from oracle_server.core.verdicts import Judged
from oracle_server.engines.native import engine_of
from tests.core.everything.cases import START, Case, Sent
from tests.core.everything.reading import Reading
from tests.episodes import Kept, expected, lines_of, told

_LONG = 40
"""How long (ns) a session goes on behind what comes last."""


class Run:
    """A session that judges a case, and what is read of its rows."""

    def __init__(self, found: Case, rng: random.Random) -> None:
        self._script, self._spec, self._rng = found.script, found.spec, rng
        self._plan, self._divided = plan(found.spec), rng.random() < 0.3
        self._simulated = found.spec.ordering.by == "arrival" and rng.random() < 0.4
        given = enumerate(orders(found.spec))
        self.readings = {order: Reading(found.spec, order, START, decides=n == 0) for n, order in given}
        self.rows: list[Judged] = []
        self._reached = dict[Order, int]()
        self._sent: list[Event] = []
        self._session = self._fresh(None)
        self._attach(START)

    def go(self) -> None:
        """Do all that is to be done, and end."""
        for one in self._script:
            self._until(one.now)
            self._tell(one.now)
            self._take(self._session.advance(one.now, wholly=True))
            getattr(self, f"_do_{one.what}")(one)
        end = self._script[-1].now + _LONG
        self._until(end)
        self._tell(end)
        self._take(self._session.finish(end))
        self._tell(end + _LONG)
        self._until(end + _LONG)
        for order, reading in self.readings.items():
            if order == "arrival" or self._spec.ordering.max_delay is not None:
                reading.settle(end - _LONG)
        self._take(self._session.end(end + _LONG))
        for order in self.readings:
            self._check(order)

    def counts(self) -> Counter[str]:
        """What happened, and what explanations claimed."""
        return sum((reading.seen + reading.told for reading in self.readings.values()), Counter[str]())

    def _check(self, order: Order) -> None:
        """Violations that were counted, and episodes."""
        states, rows = self._session.judges[order].properties, [row for row in self.rows if row.order == order]
        kept = Kept()
        kept.take(rows)
        for i, prop in enumerate(self._spec.properties):
            assert states[i].violations == self.readings[order].standing[i].violations, prop.text
            lines = lines_of(rows, self._spec, i)
            assert told(kept.of(i)) == told(expected(lines, self._spec.gap)), prop.text

    def _fresh(self, begun: int | None) -> Session:
        engines = [[engine_of(p) for p in self._spec.properties] for _ in orders(self._spec)]
        session = Session(self._plan, engines, begun=begun)
        if self._divided:
            session.divide(lambda: True)
        if self._simulated:
            session.simulate()
        return session

    def _attach(self, now: int) -> None:
        for monitor in "mn":
            self._take(self._session.attach(monitor, self._spec.by_key, now))
        self._tell(now)

    def _tell(self, now: int) -> None:
        """Have a simulation's clock tell the time, which is the server's here."""
        if self._simulated:
            self._take(self._session.clock("m", [ClockReading(self._spec.streams[-1].key, now)], now))

    def _take(self, rows: list[Judged]) -> None:
        for row in rows:
            self.rows.append(row)
            self.readings[row.order].take(row, self._reached.get(row.order, 0))
        self._reached = {order: judge._ticked for order, judge in self._session.judges.items()}

    def _until(self, now: int) -> None:
        """Let time pass as the server's timer does."""
        for _ in range(10_000):
            due = self._session.next_deadline
            if due is None or due > now:
                return
            self._take(self._session.advance(max(due, self._session.now)))
        raise AssertionError("the session never comes to rest")

    def _do_event(self, one: Sent) -> None:
        assert one.event is not None
        self._sent.append(one.event)
        for reading in self.readings.values():  # all is degraded as soon as a loss is known
            reading.degraded = reading.degraded or one.event.lost > 0
        self._take(self._session.ingest(one.event))

    def _do_clock(self, one: Sent) -> None:
        streams = self._rng.sample(self._spec.streams, 2)
        readings = [ClockReading(s.key, one.now - self._rng.choice((0, 2, 9))) for s in streams if s.ordered]
        self._take(self._session.clock(self._rng.choice("mn"), readings, one.now))

    def _do_leave(self, one: Sent) -> None:
        monitor = self._rng.choice("mn")
        self._take(self._session.detach(monitor, one.now))
        self._take(self._session.attach(monitor, self._spec.by_key, one.now))

    def _do_saved(self, one: Sent) -> None:
        """Restore it from a snapshot, where one may be taken."""
        data = self._session.snapshot() if self._session.can_be_saved else None
        if data is None:
            return
        self._session = self._fresh(self._session.begun)
        self._session.restore(json.loads(json.dumps(data)), len(self.rows) * len(self._spec.properties) + 1)
        self._resend(one.now)

    def _do_again(self, one: Sent) -> None:
        """Restore it by judging again."""
        if self._session.rows:
            return
        self._session = self._fresh(self._session.begun)
        for row in self.rows:
            if all(v.degraded for v in row.verdicts):
                self._session.judges[row.order].degrade()
            self._session.rejudge(row.order, row.step, row.judged)
        for order, reading in self.readings.items():
            reading.degraded = reading.degraded and self._session.judges[order]._degraded
        self._resend(one.now)

    def _resend(self, now: int) -> None:
        """The monitors are back, and send again what was not judged in all orders."""
        known = [{(r.step.event.monitor, r.step.event.seq) for r in self.rows if r.order == o} for o in self.readings]
        self._attach(now)
        for event in self._sent:
            if not all((event.monitor, event.seq) in each for each in known):
                self._take(self._session.ingest(msgspec.structs.replace(event, arrived=now, lost=0)))
