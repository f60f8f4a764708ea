"""A judge that goes back: it puts late events in their places, and judges what comes after them again."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from copy import copy

import msgspec

from oracle_server.core.counting import Told
from oracle_server.core.engine import Engine, rewindable
from oracle_server.core.events import Order, Signals, Step
from oracle_server.core.holding import Held
from oracle_server.core.judge import Judge, Seen
from oracle_server.core.plan import Plan, StreamPlan
from oracle_server.core.recent import SIZE, Recent
from oracle_server.core.revise.changes import differing, merged, revisions
from oracle_server.core.revise.episodes import Rewritten
from oracle_server.core.revise.finality import RevisableState, Stand
from oracle_server.core.revise.kept import MOST, Keeping, Kept, Point, key_of
from oracle_server.core.revise.queued import Asked, Late, Until
from oracle_server.core.revise.ticks import OldTicks
from oracle_server.core.revisions import Revision
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Decision, Judged, Outcome

_FORGET_AFTER = 64
"""Rows after which those that need not be kept any more are forgotten: many at once cost less."""


class RevisingJudge(Judge):
    """Judges in the order of publication, and again where a late event is put in its place.

    What is to be judged waits in `ahead` while a pass goes on; what was judged in it is returned at its end, with the
    revisions, so that both are kept together or not at all.
    """

    def __init__(self, plan: Plan, engines: Sequence[Engine], order: Order, numbers: Iterator[int]) -> None:
        """Judge with one fresh engine a property, each of which can go back; verdicts are numbered from `numbers`."""
        self.horizon = plan.spec.ordering.horizon
        self._changed: list[RevisableState] = []
        """The properties that may stand otherwise than after the last row that is kept."""
        super().__init__(plan, engines, order, numbers)
        self._states = [state for state in self.properties if isinstance(state, RevisableState)]
        self._engines = [rewindable(engine) for engine in engines]
        self._recent = Recent(SIZE, spare=MOST)
        self._width = len(engines)
        self.keeping = Keeping(self.horizon, self._point())
        self.newest = 0
        """The time of the newest step (ns)."""
        self.ticking = False
        """Whether deadlines are judged."""
        self._level = 0
        """Up to when (ns) deadlines were judged, in so far as there were any."""
        self._deadline = 0
        """The latest deadline that was judged (ns); a step that is no younger is late."""
        self._numbered = 0  # steps that were judged
        self._position = 0  # of the last row that is no revision
        self.ahead: deque[Kept | Late | Step | Until] = deque()
        """What is to be judged in a pass; empty where none goes on."""
        self.overtaken: list[Step] = []
        """Steps that came while a pass went on, and are late since; whoever calls `go_on` takes them."""
        self._causes: list[Step] = []
        self._outputs: list[Judged] = []
        self._stood: dict[int, Kept] = {}
        """The rows that are judged again in this pass, by position."""
        self._stands: dict[int, tuple[Judged, Decision | None]] = {}
        self._old_ticks = OldTicks(self._derived.seen)
        self._not_before = 0
        """What is judged again without being in order is judged at no earlier time (ns) than it was."""
        self._added = 0  # rows, since others were forgotten
        self._told: Told | None = None
        self._rewritten: Rewritten | None = None  # of the pass that goes on
        self.asked: Asked | None = None
        self.answer: Judged | None = None
        """The row that is `asked` of as it stands, with the explanation; None where it does not stand."""
        for engine in self._engines:
            engine.record()
        self._derived.record()

    def remember(self, steps: int, effort: int) -> None:
        """See `Telling.remember`."""
        self._recent = Recent(steps, effort, MOST)

    def _state(self, prop: Property, engine: Engine, grace: int) -> RevisableState:
        return RevisableState(prop, engine, grace=grace, horizon=self.horizon, changed=self._changed)

    @property
    def told(self) -> Told:
        """How its properties stand, and what it has counted: while a pass goes on, as before it."""
        return self._told or super().told

    @property
    def is_going(self) -> bool:
        """Whether a pass goes on."""
        return bool(self.ahead)

    def is_late(self, step: Step) -> bool:
        """Whether a step is older than what was judged, where a deadline counts as younger than a step at its time."""
        time = step.time
        return time < self.newest or time <= self._deadline

    def has_place(self, step: Step) -> bool:
        """Whether a late step can still be put in its place."""
        return step.time >= self.newest - self.horizon and key_of(step.time) >= self.keeping.floor

    def take(self, step: Step, now: int) -> list[Judged]:
        """Judge a step behind all others, and the deadlines before it; while a pass goes on it waits for that."""
        if self.ahead:
            self.ahead.append(step)
            return []
        if not self.ticking:
            return [self._judge_first(step, now)]
        return [*self._judge_deadlines(self._level_before(step), now), self._judge_first(step, now)]

    def tick_until(self, until: int, now: int, enough: Callable[[], bool]) -> tuple[list[Judged], bool]:
        """Judge the deadlines up to a time (ns), until enough was done, and return whether all are.

        While a pass goes on they wait for that.
        """
        if not self.ahead:
            judged = self._judge_deadlines(until, now, enough)
            return judged, (deadline := self.next_deadline) is None or deadline > until
        last = self.ahead[-1]
        if isinstance(last, Until):
            self.ahead[-1] = Until(max(until, last.time))
        else:
            self.ahead.append(Until(until))
        return [], True

    def place(self, late: Sequence[Step], level: int = 0) -> None:
        """Begin a pass that puts late steps in their places; each of them has one, and no pass goes on.

        Deadlines up to `level` (ns) are judged in it, if these are not yet.
        """
        self._begin_pass()
        self._level = max(self._level, level)
        self._causes = sorted(late, key=lambda step: step.time)  # a stable sort: of equal times by arrival
        steps = deque(self._causes)
        taken = self.keeping.after(steps[0].time)
        self._go_back(taken)
        for row in reversed(taken):
            while steps and key_of(steps[0].time) < row.key:
                self.ahead.append(Late(steps.popleft()))
            if not row.is_tick:
                self.ahead.append(row)
        self.ahead.extend(map(Late, steps))
        self.ahead.append(Until(self._level))

    def _begin_pass(self) -> None:
        self._told = Told([copy(state) for state in self.properties], copy(self.counters))
        self._causes = []

    def go_on(self, now: int, enough: Callable[[], bool]) -> list[Judged]:
        """Go on with the pass until enough was done; what was judged in it is returned at its end."""
        while self.ahead:
            item = self.ahead.popleft()
            match item:
                case Until(time):
                    self._outputs += self._judge_deadlines(time, now)
                case Kept():
                    self._outputs += self._judge_deadlines(item.level, now)
                    self._judge_again(item)
                case Late(step):
                    self._outputs += self._judge_deadlines(step.time - 1, now)
                    self._outputs.append(self._judge_first(step, now, placed=True))
                case _ if self._is_overtaken(item):
                    self.overtaken.append(item)
                case _:
                    self._outputs += self._judge_deadlines(self._level_before(item), now)
                    self._outputs.append(self._judge_first(item, now))
            if enough():
                break
        return [] if self.ahead else self._end(now)

    def _is_overtaken(self, step: Step) -> bool:
        """Whether a deadline that waited before a step was no older, so that it is late."""
        return not (step.late or step.skipped) and self._is_ordered(step) and self.is_late(step)

    def _end(self, now: int) -> list[Judged]:
        """End the pass: what was judged in it, and the revisions of what stood before."""
        outputs, self._outputs = self._outputs, []
        if self._causes:
            names = [state.property.id for state in self.properties]
            again = differing(self._stood, self._stands)
            made = revisions(again, names, [step.event for step in self._causes], now, self._numbers)
            self._count_changes(made)
            outputs += made
        outputs = outputs if self._rewritten is None else self._rewritten.told(outputs, self.following)
        self._stood, self._stands, self._told, self._rewritten = {}, {}, None, None
        self._old_ticks.clear()
        return outputs

    def _count_changes(self, made: Sequence[Revision]) -> None:
        changes = [change for row in made for change in row.changes if change is not None]
        self.counters.revised += len(changes)
        self.counters.retracted += sum(change.retracted for change in changes)

    def _level_before(self, step: Step) -> int:
        """Up to when deadlines are judged before a step that is judged behind all others.

        Where it is not in order, those that were judged by then, so that what comes in order behind it is younger.
        """
        return step.time - 1 if self._is_ordered(step) and not step.late else self._deadline

    def _key_behind(self, level: int) -> int:
        """The key of a step that is not in order: behind all that was judged, and deadlines up to a level (ns)."""
        return max(key_of(self.present), key_of(level, tick=True))

    def _is_ordered(self, step: Step) -> bool:
        return self.plan.streams[step.event.stream].spec.ordered

    def _judge_deadlines(self, until: int, now: int, enough: Callable[[], bool] | None = None) -> list[Judged]:
        outputs: list[Judged] = []
        if not self.ticking:
            return outputs
        self._level = max(self._level, until)
        while (deadline := self.next_deadline) is not None and deadline <= until:
            self._deadline = max(self._deadline, deadline)
            tick = self._judge_deadline(deadline, now)
            if tick is not None:
                outputs.append(tick)
            if enough is not None and enough():
                break
        return outputs

    def _judge_deadline(self, time: int, now: int) -> Judged | None:
        """Judge a deadline; None where it changes nothing, and where it was told before."""
        tick = self.tick(time, now)
        if tick is None:
            return None
        old = self._stood.get(self._position_of(tick))
        if old is None:
            self._keep_tick(tick, time)
            return tick
        self._stands[old.position] = tick, None
        self._keep_again(tick, old, time)
        return None

    def tick(self, time: int, now: int, recorded: Signals | None = None) -> Judged | None:
        """Judge a step at `time` with held signals only, and take it back; None where it changes no outcome."""
        if self.asked is None or self.asked.tick != time:
            return super().tick(time, now, recorded)
        state = self.properties[self.asked.prop]
        state.asked = True
        tick = super().tick(time, now, recorded)
        state.asked = False
        if tick is not None and self._position_of(tick) == self.asked.position:
            self.answer = tick
        return tick

    def _ticked_with(
        self, found: Sequence[Outcome], seen: Seen, stored: Seen, time: int, now: int, source: str = ""
    ) -> Judged:
        old = self._old_ticks.take(time, stored[0])
        if old is None:
            return super()._ticked_with(found, seen, stored, time, now, source)
        numbers, ticks, degraded = self._numbers, self.counters.ticks, self._degraded
        self._numbers, self._degraded = old.numbers, False
        tick = super()._ticked_with(found, seen, stored, time, old.judged.judged, source)
        self._numbers, self.counters.ticks, self._degraded = numbers, ticks, degraded
        return msgspec.structs.replace(tick, step=old.step, verdicts=merged(old.judged.verdicts, tick.verdicts))

    def _keep_tick(self, tick: Judged, time: int) -> None:
        """Keep a deadline that was told for the first time."""
        self._keep(tick, key_of(time, tick=True), time)

    def _judge_first(self, step: Step, now: int, *, placed: bool = False) -> Judged:
        """Judge a step for the first time: in its place, or behind all others."""
        steps = self.counters.steps
        self._recent.number = self._numbered + 1
        judged = self.judge(step, now)
        undone = self.counters.steps == steps
        self._numbered += not undone
        if placed:
            number = None if undone else self._numbered
            judged = msgspec.structs.replace(judged, number=number, place=steps + 1)
            self._renumber(judged)
        if step.skipped:
            self._position = self._position_of(judged)
        elif placed or (not step.late and self._is_ordered(step)):
            time = step.time
            self._keep(judged, key_of(time), time - 1, undone=undone)
        else:
            self._keep(judged, self._key_behind(self._deadline), self._deadline, undone=undone)
        return judged

    def _judge_again(self, row: Kept) -> None:
        """Judge a kept step again, as it was decided."""
        numbers, degraded, denied = self._numbers, self._degraded, self.counters.denied
        self._numbers, self._degraded = row.numbers, False
        broken = [
            (state, v) for state, v in zip(self._states, row.judged.verdicts, strict=True) if state.broken is not None
        ]
        for state, verdict in broken:
            state.repeated = verdict.outcome
        self._not_before, self._recent.number = row.point.present, row.judged.number
        asked = None if self.asked is None or self.asked.position != row.position else self._states[self.asked.prop]
        if asked is not None:
            asked.asked = True
        if row.undone:
            before = self._attempt(row.step)
            judged = self._take_back(self._judge(row.step, row.judged.judged, revisable=True), before)
        else:
            judged = self._judge(row.step, row.judged.judged)
        self._not_before, self._numbers, self._degraded, self.counters.denied = 0, numbers, degraded, denied
        for state, _ in broken:
            state.repeated = None
        stands, verdicts = row.judged, merged(row.judged.verdicts, judged.verdicts)
        if verdicts is not stands.verdicts:
            stands = msgspec.structs.replace(stands, verdicts=verdicts)
        if asked is not None:
            self.answer, asked.asked = stands, False
        self._renumber(stands)
        decided, would = row.judged.decision, judged.decision
        other = would if decided is not None and would is not None and would.choice != decided.choice else None
        self._stands[row.position] = stands, other
        self._keep_again(stands, row, row.level)

    def _renumber(self, judged: Judged) -> None:
        """Name a first violation by the number that its step was judged with, which is not its place."""
        for state, verdict in zip(self.properties, judged.verdicts, strict=True):
            if verdict.explanation is not None:
                state.note_first(verdict.n, judged.number, judged.step.stamp)

    def _go_back(self, taken: Sequence[Kept]) -> None:
        """Go back to before these rows, the last of which comes first."""
        for row in taken:
            self._stood[row.position] = row
            if row.is_tick:
                self._old_ticks.add(row)
        self._derived.rewind(row.noted for row in taken)
        point = self.keeping.last
        self._recent.remove(self.counters.steps - point.steps)
        for state, engine, stand in zip(self._states, self._engines, point.properties, strict=True):
            if state.broken is None and not state.said:
                engine.rewind(point.steps, point.present, point.before)
            state.put(stand)
        self.present, self._ticked, self._outdated = point.present, point.ticked, point.outdated
        self.counters.steps, self._held, self.following = point.steps, dict(point.held), point.following
        self._rewritten = Rewritten(point.following, reversed(taken))

    def _keep(self, judged: Judged, key: int, level: int, *, undone: bool = False) -> None:
        """Keep a row that was judged for the first time."""
        position = self._position_of(judged)
        self._add(judged, max(key, self.keeping.key), level, position, self._position, undone=undone)
        self._position = position

    def _keep_again(self, judged: Judged, old: Kept, level: int) -> None:
        """Keep a row that was judged again, in the place that it has."""
        self._add(judged, old.key, level, old.position, old.preceding, undone=old.undone)

    def _add(self, judged: Judged, key: int, level: int, position: int, preceding: int, *, undone: bool) -> None:
        keeping, last, present, steps = self.keeping, self.keeping.last, self.present, self.counters.steps
        before = last.present if steps > last.steps else last.before
        stands = self._stand() if self._changed else last.properties
        point = Point(present, before, self._ticked, self._outdated, steps, self._held, stands, self.following)
        if present > self.newest:  # noqa: PLR1730 -- `max` takes longer than all else here
            self.newest = present
        row = Kept(judged, key, level, position, preceding, point, undone, self._derived.noted())
        keeping.add(row, self.newest)
        if self._rewritten is not None:
            self._rewritten.stands(row)
        self._added += 1
        if self._added >= _FORGET_AFTER:
            self.forget()

    def forget(self) -> None:
        """Keep no rows, and nothing in the engines, for events that are older than the horizon."""
        self._added = 0
        self.keeping.forget(self.newest)
        base = self.keeping.base
        for state, engine in zip(self._states, self._engines, strict=True):
            if state.broken is None:
                engine.forget(base.steps, base.present)

    def _point(self, before: int = 0) -> Point:
        """How the judge stands where no row is kept; `before` is the time of the step before the last one (ns)."""
        steps, stands = self.counters.steps, self._stand()
        return Point(self.present, before, self._ticked, self._outdated, steps, self._held, stands, self.following)

    def _stand(self) -> tuple[Stand, ...]:
        """How its properties stand, which have not changed since."""
        self._changed.clear()
        return tuple([state.stand() for state in self._states])

    def _position_of(self, judged: Judged) -> int:
        return (judged.verdicts[0].n - 1) // self._width + 1

    def _move_on(self, step: Step, stream: StreamPlan) -> None:
        if stream.spec.ordered and not self._not_before:
            self.present = max(self.present, step.time)
        else:
            super()._move_on(step, stream)
            self.present = max(self.present, self._not_before)

    def _holding(self, monitor: str) -> Held:
        self._held = {m: h.copy() if m == monitor else h for m, h in self._held.items()}  # points refer to the other
        return super()._holding(monitor)
