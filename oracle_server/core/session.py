"""A session: the events of its monitors, put in order and judged. Synchronous, and without any I/O."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence

import msgspec

from oracle_server.core.arriving import Arriving
from oracle_server.core.asking import Ask, Asking, Waiting
from oracle_server.core.bypass import Bypass, Bypasses
from oracle_server.core.engine import Answer, Engine
from oracle_server.core.events import Event, Order, Source, Step, StreamKey
from oracle_server.core.judging.judge import Judge
from oracle_server.core.ordering.monitorclocks import MonitorClocks
from oracle_server.core.ordering.reorder import Released, ReorderBuffer
from oracle_server.core.ordering.settling import NEVER, Settling
from oracle_server.core.ordering.simulated import ClockReading, SimulatedTime
from oracle_server.core.plan import Plan
from oracle_server.core.resumable import Resumable
from oracle_server.core.revise.judge import RevisingJudge
from oracle_server.core.revise.lateness import Lateness
from oracle_server.core.revise.saving import SavableJudge
from oracle_server.core.rows import Rows
from oracle_server.core.spec import SECOND, orders
from oracle_server.core.tally import HoldTimes
from oracle_server.core.verdicts import FINAL, Judged

Put = Callable[[Step, Source, str, int, int], list[Released[Step]]]
_NONE = frozenset[str]()
_LOOK_AGAIN = SECOND
"""How long expired deadlines wait while nothing can be judged, in nanoseconds."""


class Session(Resumable):
    """Judges the events of its monitors against the properties of one spec.

    Every method takes the present time in nanoseconds and returns what was judged, in order. Time never goes back: an
    earlier time counts as the latest one seen.
    """

    def __init__(
        self, plan: Plan, engines: Sequence[Sequence[Engine]], *, ticking: bool = True, begun: int | None = None
    ) -> None:
        """Start with fresh engines: for each order of `orders`, one a property.

        `ticking`: expired deadlines are judged. `begun` is when a session that is judged again began.
        """
        ordering = plan.spec.ordering
        numbers = itertools.count(1)
        self.plan = plan
        self.lateness: Lateness | None = None
        """What comes late and is put in its place; None where the spec does not revise."""
        self.judges: dict[Order, Judge] = {}
        for order, own in zip(orders(plan.spec), engines, strict=True):
            if ordering.late == "revise":
                revising = self.judges[order] = SavableJudge(plan, own, order, numbers)
                revising.ticking = ticking and plan.timed
                self.lateness = Lateness(revising)
            else:
                self.judges[order] = Judge(plan, own, order, numbers, decides=order == orders(plan.spec)[0])
        self.buffer: ReorderBuffer[Step] = ReorderBuffer(ordering.max_delay, ordering.capacity)
        self._settling = Settling(ordering, self.buffer)
        self.returning = self._settling.returning
        """Monitors that were attached before a restart: deadlines wait for them."""
        self.counts = self.judges[orders(plan.spec)[0]].counts
        for judge in self.judges.values():
            judge.counts = self.counts
        self.clocks = MonitorClocks(plan.spec.by_key, ordering.max_skew)
        """What the clocks of its monitors have told."""
        self.holds = HoldTimes()
        self.bypasses = Bypasses(plan.readers)
        self.now = 0
        self.begun: int | None = None
        """When the first monitor attached, in the session's own time (ns): what never comes is missed from then on."""
        if begun is not None:
            self._begin(begun)
        self._ticking = ticking and plan.timed
        self._arriving = Arriving(plan)
        self.rows = Rows()
        self.asking = Asking() if plan.external else None
        """What waits for external oracles; None where the spec has none."""
        self.suspended = False
        """Whether events are skipped, since their verdicts could not be kept."""
        self._enough: Callable[[], bool] = _never
        self._unticked: dict[Order, int] = {}
        """Until when expired deadlines are still to be judged before anything else, where enough was done."""

    @property
    def simulated(self) -> SimulatedTime | None:
        """The time of the simulation that the session runs in; None where its time is the server's."""
        return self._arriving.simulated

    def simulate(self) -> None:
        """Run in the time of a simulation from now on; a restored session has that of its newest step."""
        known = max(judge.present for judge in self.judges.values()) or None
        self._arriving.simulated = self._settling.simulated(self.plan.spec.by_key, known)

    @property
    def next_deadline(self) -> int | None:
        """When `advance` should be called next, None while nothing waits for time to pass."""
        late = self.lateness
        if self.rows or self.buffer.due is not None or self._unticked or (late is not None and late.judge.ahead):
            return self.now
        deadline = self.buffer.next_deadline
        if late is not None and late.due is not None:
            deadline = late.due if deadline is None else min(deadline, late.due)
        if not self._ticking or self.asking:
            return deadline
        ticks = [
            due
            for order, judge in self.judges.items()
            if (tick := judge.next_deadline) is not None
            and (due := self._settling.due(order, tick, self.now, self.simulated)) is not None
        ]
        if self.suspended:  # no deadline is judged now, however long ago it expired
            ticks = [max(tick, self.now + _LOOK_AGAIN) for tick in ticks]
        return min((d for d in (deadline, *ticks) if d is not None), default=None)

    @property
    def has_due(self) -> bool:
        """Whether anything is left that is due by the order, or that a late event has judged again."""
        if self.rows or self.buffer.due is not None or self.is_revising:
            return True
        due = None if self.lateness is None else self.lateness.due
        return due is not None and due <= self.now

    def divide(self, enough: Callable[[], bool]) -> None:
        """Judge what the order releases at once, and deadlines, one by one until `enough`; the rest is due at once.

        That changes when something is judged, and what is in order keeps it; a late event does not wait for the rest.
        """
        self.buffer.most, self._enough = 1, enough

    def attach(self, monitor: str, streams: Iterable[StreamKey], now: int) -> list[Judged]:
        """Wait for the ordered ones of these streams of a monitor from now on, and for no others of it."""
        ordered = [s for s in streams if self.plan.spec.by_key[s].ordered]
        judged = self.advance(now)
        if self.begun is None and self.simulated is None:
            self._begin(self.now)
        return judged + self._judge(self.buffer.open(monitor, ordered)) + self._run_out()

    def detach(self, monitor: str, now: int) -> list[Judged]:
        """Stop waiting for a monitor: its streams leave the order, what it sent stays."""
        return self.advance(now) + self._judge(self.buffer.close(monitor)) + self._run_out()

    def ingest(self, event: Event) -> list[Judged]:
        """Take an event of a stream of the spec, at its time of arrival."""
        judged = self.advance(event.arrived, wholly=True)
        if event.lost:  # held events may be younger than what was lost: verdicts are degraded as soon as it is known
            self.note_loss()
        step = self._arriving.step(event)
        if self.returning:
            told = self.simulated is None or self.simulated.is_told  # else what has a stamp arrives at that
            timeless = told and step.time == step.event.arrived
            self.returning.hear(event.monitor, None if timeless else step.time, self.now)
        if self.begun is None and not (self.simulated is not None and step.skewed):  # else it is of another time
            self._begin(step.event.arrived)
        if "arrival" in self.judges:
            judged += self._judge_one("arrival", step) if self.asking is None else self._ask("arrival", step)
        if "publication" in self.judges:
            judged += self._order(step)
        return judged + self._run_out() if self._ticking else judged

    def clock(self, monitor: str, readings: Iterable[ClockReading], now: int) -> list[Judged]:
        """Take a monitor's clock: the times before which its streams have no more events."""
        judged = self.advance(now)
        readings = tuple(readings)
        believed = [self._arriving.clock(r.stamp, self.now) for r in readings]
        self.clocks.note(monitor, readings, believed, self.now)
        if self.simulated is not None:
            self.simulated.update(readings, self.now)
            if self.begun is None and self.simulated.now is not None:
                self._begin(self.simulated.now)
        if self.returning:
            for told in believed:
                self.returning.hear(monitor, told, self.now)
        sources = ((monitor, r.stream) for r in readings)
        return judged + self._judge(self.buffer.clock(*zip(sources, believed, strict=True))) + self._run_out()

    def goes_back(self, monitor: str, readings: Sequence[ClockReading]) -> bool:
        """Whether a monitor's clock says that it was set back, or its simulation's: all that came would be late."""
        if self.simulated is not None:
            return self.clocks.is_back(monitor, readings, self.simulated.now, wall=False)
        judge = self.judges.get("publication")  # by arrival nothing is late
        return judge is not None and self.clocks.is_back(monitor, readings, judge.present or None, wall=True)

    @property
    def is_behind(self) -> bool:
        """Whether rows or expired deadlines wait, or steps that are judged again, and what comes next behind them."""
        return bool(self.rows or self._unticked or (self.lateness is not None and self.lateness.judge.ahead))

    @property
    def is_revising(self) -> bool:
        """Whether steps are judged again because of late events."""
        return self.lateness is not None and self.lateness.judge.is_going

    def advance(self, now: int, *, wholly: bool = False) -> list[Judged]:
        """Let time pass: judge what has waited for `max_delay`, and expired deadlines, `wholly` or until enough."""
        self.now = max(self.now, now)
        judged = self.rows.judge(self._judge_one, None if wholly else self._enough) if self.rows else []
        if self.rows:
            return judged
        released = self.buffer.advance(self.now)
        judged += self._judge(released) if released else []
        if self.rows and wholly:
            judged += self.rows.judge(self._judge_one, None)
        late = None if self.rows else self.lateness
        if late is not None and (late.due is not None or late.judge.ahead or late.judge.unknown):
            judged += late.go_on(self.now, self._enough)
        return judged + self._run_out(wholly=wholly) if self._ticking else judged

    def release(self) -> bool:
        """Let all that is held be due, or where nothing is, what is late; return whether there is any for `advance`."""
        if self.buffer.first is not None:
            self.buffer.expire()
        elif self.lateness is not None:
            self.lateness.expire(self.now)
        return self.has_due

    def finish(self, now: int) -> list[Judged]:
        """Judge all that is held, in order."""
        enough, self._enough = self._enough, _never
        judged = self.advance(now) + self._judge(self.buffer.flush())
        if self.lateness is not None:
            judged += self.lateness.finish(self.now)
        self._enough = enough
        return judged

    def end(self, now: int) -> list[Judged]:
        """After `finish`: nothing will come any more; judge what is open of properties with `at_end: violated`."""
        self.now = max(self.now, now)
        judged = [] if self.lateness is None else self.lateness.finish(self.now)  # a snapshot has begun a pass
        return judged + [ended for judge in self.judges.values() if (ended := judge.end(self.now)) is not None]

    def take_asks(self) -> list[Ask]:
        """The questions to external oracles that were not taken yet; each is to be answered by `resolve`."""
        return [] if self.asking is None else self.asking.take()

    def resolve(self, ask: Ask, answer: Answer, now: int) -> list[Judged]:
        """Take an external oracle's answer: judge what waited for it, and what waited behind that."""
        assert self.asking is not None  # noqa: S101 -- there was a question
        self.now = max(self.now, now)
        self.asking.answer(ask.number, ask.property, answer)
        return self._leave() + self._run_out()

    def abandon(self, reason: str, now: int) -> list[Judged]:
        """Stop waiting for external oracles: the outcome of every missing answer is unknown."""
        if self.asking is None:
            return []
        self.now = max(self.now, now)
        self.asking.give_up(reason)
        return self._leave() + self._run_out()

    def receive(self, order: Order, answers: Mapping[int, Answer]) -> None:
        """Use answers of external oracles for the next step in an order, by the indexes of their properties."""
        for index, answer in answers.items():
            self.judges[order].properties[index].receive(answer)

    def hold(self, step: Step) -> list[Judged]:
        """Put a step back into the order of publication, where it was before and was not judged yet."""
        return self._order(step, self.buffer.put_back)

    def _begin(self, time: int) -> None:
        self.begun = time
        for judge in self.judges.values():
            judge.begin(time)

    def _order(self, step: Step, put: Put | None = None) -> list[Judged]:
        event = step.event
        if not self.plan.spec.by_key[event.stream].ordered:
            return self._judge_one("publication", step) if self.asking is None else self._ask("publication", step)
        source = (event.monitor, event.stream)
        return self._judge((put or self.buffer.push)(step, source, event.source, step.time, self.now))

    def _judge(self, released: Sequence[Released[Step]]) -> list[Judged]:
        """Judge what was released, and what is due behind it until enough was done."""
        judged = self._judge_all(released)
        while not self.rows and self.buffer.due is not None and not self._enough():
            judged += self._judge_all(self.buffer.more())
        return judged

    def _judge_all(self, released: Sequence[Released[Step]]) -> list[Judged]:
        for r in released:
            self.holds.add(self.now - r.item.event.came)
        judged: list[Judged] = []
        for step in map(self._marked, released):
            if self.rows:
                judged += self.rows.judge(self._judge_one, None)
            if self._ticking and not step.late and self.lateness is None:
                judged += self._ticks("publication", step.time - 1)
            judged += self._judge_one("publication", step) if self.asking is None else self._ask("publication", step)
        return judged

    def _run_out(self, *, wholly: bool = False) -> list[Judged]:
        """Judge expired deadlines for which no older event can come any more, or is waited for any longer."""
        judged: list[Judged] = []
        for order in self.judges if self._ticking and not self.rows else ():
            settled = self._settling.until(order, self.now, self.simulated)
            reached = [] if settled is None else [settled]
            if order == "publication" and self.buffer.limit is not None:
                reached.append(self.buffer.limit - 1)  # an event of that very time may still come
            if order in self._unticked:
                reached.append(self._unticked[order])
            if reached:
                judged += self._ticks(order, min(max(reached), self._before_due(order)), wholly=wholly)
        return judged

    def _before_due(self, order: Order) -> int:
        """Up to when deadlines may be judged: those behind what is due come after it."""
        due = self.buffer.due if order == "publication" else None
        return NEVER if due is None else due - 1

    def _ticks(self, order: Order, until: int, *, wholly: bool = True) -> list[Judged]:
        if self.asking:
            self.asking.add_ticks(order, until)
            return []
        return self._tick_until(order, until, wholly=wholly or self.asking is not None)

    def _tick_until(self, order: Order, until: int, *, wholly: bool = True) -> list[Judged]:
        """Judge deadlines up to a time, and first up to that at which enough was done before."""
        judge, judged = self.judges[order], list[Judged]()
        until = max(until, self._unticked.pop(order, until))
        if isinstance(judge, RevisingJudge):
            if not self.suspended:
                judged, done = judge.tick_until(until, self.now, _never if wholly else self._enough)
                self._unticked |= {} if done else {order: until}
            return judged
        while (deadline := self._next_tick(judge)) is not None and deadline <= until:
            if not judge.decide(deadline, _never if wholly else self._enough):
                self._unticked[order] = until
                break
            tick = judge.tick(deadline, self.now)
            if tick is not None:
                judged.append(tick)
            if not wholly and self._enough():
                self._unticked[order] = until
                break
        return judged

    def _next_tick(self, judge: Judge) -> int | None:
        """The next deadline to judge; while nothing can be kept only one of which a part is decided already."""
        return judge.next_deadline if not self.suspended or judge.is_deciding else None

    def bypass(self, monitor: str, streams: Mapping[StreamKey, Bypass]) -> None:
        """Note which streams of a monitor are bypassed now: until that ends, what is judged by them is degraded."""
        self.bypasses.update(monitor, streams)
        for judge in self.judges.values():
            judge.bypass(self.bypasses.properties)

    def _judge_one(self, order: Order, step: Step) -> list[Judged]:
        if step.rows:
            self.rows.add(order, step)
            together = self.lateness is not None and (step.late or self.lateness.judge.is_late(step))
            return self.rows.judge(self._judge_one, None if together else self._enough)
        if self.suspended:
            step = msgspec.structs.replace(step, skipped=True)
        if self.lateness is not None:
            return self.lateness.take(step, self.now, self._enough)
        return [self.judges[order].judge(step, self.now)]

    def _marked(self, released: Released[Step]) -> Step:
        """A released step with what the order knows of it."""
        step, late = released.item, released.late
        skipped = late and self.plan.spec.ordering.late == "skip"
        heard = self.lateness is None or released.why in ("frontier", "clock")
        return Step(
            step.event, step.signals, step.failed, step.stamp, step.skewed, late, released.why == "capacity", skipped,
            released.why, _NONE if heard else self.buffer.unheard(step.time), released.waited, step.rows,
        )  # fmt: skip

    def _ask(self, order: Order, step: Step) -> list[Judged]:
        """Ask external oracles about a step whose turn has come, and judge it where it waits for none."""
        assert self.asking is not None  # noqa: S101 -- only called where some are asked
        judge, stream = self.judges[order], self.plan.streams[step.event.stream]
        if self.suspended:
            step = msgspec.structs.replace(step, skipped=True)
        asked = () if step.skipped else stream.asked
        earliest = max(judge.present, self.asking.latest.get(order, 0)) or min(step.time, step.event.arrived)
        own = step.event.arrived if order == "arrival" else step.time if stream.spec.ordered else earliest
        open_ones = [i for i in asked if judge.properties[i].outcome not in FINAL]
        self.asking.add(order, step, open_ones, max(earliest, own))
        return self._leave()

    def _leave(self) -> list[Judged]:
        """Judge what does not wait for an answer any more, in its order."""
        assert self.asking is not None  # noqa: S101 -- only called where some are asked
        judged: list[Judged] = []
        for item in self.asking.leaving():
            if not isinstance(item, Waiting):
                judged += self._tick_until(item.order, item.until)
                continue
            self.receive(item.order, item.answers)
            judged += self._judge_one(item.order, item.step) + self.rows.judge(self._judge_one, None)
        return judged


def _never() -> bool:
    return False
