"""A judge that goes back: it puts late events in their places, and judges what comes after them again."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import partial

import msgspec

from oracle_server.core.engine import Engine
from oracle_server.core.events import Order, Signals, Step
from oracle_server.core.judging.counting import Told
from oracle_server.core.judging.judge import Seen
from oracle_server.core.plan import Plan
from oracle_server.core.revise.changes import differing, merged, revisions
from oracle_server.core.revise.episodes import Rewritten
from oracle_server.core.revise.kept import Kept, key_of
from oracle_server.core.revise.queued import Asked, Late, Until
from oracle_server.core.revise.rewindable import RewindableJudge
from oracle_server.core.revise.ticks import OldTicks
from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Decision, Judged, Outcome

FEW = 16
"""Deadlines that may be judged again with each step that is not in order, beside those that have not waited yet."""


class RevisingJudge(RewindableJudge):
    """Judges in the order of publication, and again where a late event is put in its place.

    What is to be judged waits in `ahead` while a pass goes on; what was judged in it is returned at its end, with the
    revisions, so that both are kept together or not at all.
    """

    def __init__(self, plan: Plan, engines: Sequence[Engine], order: Order, numbers: Iterator[int]) -> None:
        """Judge with one fresh engine a property, each of which can go back; verdicts are numbered from `numbers`."""
        super().__init__(plan, engines, order, numbers)
        self.ticking = False
        """Whether deadlines are judged."""
        self.recurring: Callable[[], int] | None = None
        """Recalls how the next row was said, and returns when (ns), where all was judged before."""
        self._level = 0
        """Up to when (ns) deadlines were judged, in so far as there were any."""
        self._deadline = 0
        """The latest deadline that was told, or stands before a step without order (ns); a step no younger is late."""
        self._numbered = 0  # steps that were judged
        self._placing = False  # whether the step that is judged is late, and is put in its place
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
        self._told: Told | None = None
        self.asked: Asked | None = None
        self.answer: Judged | None = None
        """The row that is `asked` of as it stands, with the explanation; None where it does not stand."""

    @property
    def told(self) -> Told:
        """How its properties stand, and what it has counted: while a pass goes on, as before it."""
        return self._told or super().told

    @property
    def is_going(self) -> bool:
        """Whether a pass goes on."""
        return bool(self.ahead)

    @property
    def said(self) -> int:
        """How many rows the pass that goes on has said so far."""
        return len(self._outputs)

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
        return self._judge_behind(step, now)

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
        states = [copy(state) for state in self.properties]
        self._told = Told(states, copy(self.counters), self.following, self._degraded)
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
                    self._outputs += self._judge_behind(item, now)
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

    def _judge_behind(self, step: Step, now: int) -> list[Judged]:
        """Judge a step behind all others, and the deadlines before it."""
        outputs: list[Judged] = []
        if self._is_placed(step):
            level = step.time - 1
        else:
            outputs = self._judge_deadlines(self._deadline, now)
            level = self._level_behind(step)
        if self._ticked > level:
            self._stand_as_last()
        outputs += self._judge_deadlines(level, now)
        outputs.append(self._judge_first(step, now, level=level))
        return outputs

    def _is_placed(self, step: Step) -> bool:
        """Whether a step stands where its time has it, and not behind what was told before it."""
        return self._is_ordered(step) and not step.late

    def _level_behind(self, step: Step, *, again: bool = False) -> int:
        """Up to when (ns) deadlines stand before a step that is not in order; `again`: it was judged before.

        It stands right behind the last row. Deadlines that changed nothing are no rows: those that were judged since
        are judged again behind it. Where many of them had waited long enough, they stand before it. A restored session
        finds the same by its rows.
        """
        wait = self.plan.spec.ordering.max_delay
        waited = 0 if wait is None else step.event.arrived - max(1, wait)
        if waited <= self._deadline or not self.ticking:
            return self._deadline
        if not (again or self.recurring):
            self._stand_as_last()
        return waited if self._are_many(waited) else self._deadline

    def _are_many(self, until: int) -> bool:
        """Whether more than a few deadlines come behind the last row, up to a time (ns)."""
        known, found = (self._ticked, self._outdated), 0
        self._outdated = False
        while found <= FEW and (deadline := self.next_deadline) is not None and deadline <= until:
            self._ticked, found = deadline, found + 1
        self._ticked, self._outdated = known
        return found > FEW

    def _key_behind(self, level: int) -> int:
        """The key of a step that is not in order: behind all that was judged, and deadlines up to a level (ns)."""
        return max(key_of(self.present), key_of(level, tick=True))

    def _surely_past(self, step: Step) -> int:
        """Nothing but its stamp, of a step that stands where that has it: a deadline tells that a grace is over."""
        return 0 if self._placing or self._is_placed(step) else super()._surely_past(step)

    def _is_ordered(self, step: Step) -> bool:
        return self.plan.streams[step.event.stream].spec.ordered

    def _judge_deadlines(self, until: int, now: int, enough: Callable[[], bool] | None = None) -> list[Judged]:
        outputs: list[Judged] = []
        if not self.ticking:
            return outputs
        self._level = max(self._level, until)
        while (deadline := self.next_deadline) is not None and deadline <= until:
            tick = self._judge_deadline(deadline, now)
            if tick is not None:
                outputs.append(tick)
            if enough is not None and enough():
                break
        return outputs

    def _judge_deadline(self, time: int, now: int) -> Judged | None:
        """Judge a deadline; None where it changes nothing, and where it was told before."""
        if self.recurring is not None:
            now = self.recurring()
        tick = self.tick(time, now)
        if tick is None:
            return None
        old = self._stood.get(self._position_of(tick))
        if old is None:
            self._keep_tick(tick, time)
            return tick
        self._stands[old.position] = tick, None
        self._keep(tick, old.key, time, undone=old.undone, old=old)
        return None

    def tick(self, time: int, now: int, recorded: Signals | None = None) -> Judged | None:
        """Judge a step at `time` with held signals only, and take it back; None where it changes no outcome."""
        if self.asked is None or self.asked.tick != time:
            return super().tick(time, now, recorded)
        return self._answering(self.asked, partial(super().tick, time, now, recorded))

    def _answering(self, asked: Asked, ticks: Callable[[], Judged | None]) -> Judged | None:
        """Judge a deadline that may be the one that is asked of."""
        state = self.properties[asked.prop]
        state.asked = True
        tick = ticks()
        state.asked = False
        if tick is not None and self._position_of(tick) == asked.position:
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

    def end(self, now: int, at: int | None = None) -> Judged | None:
        """Say what is final within the horizon: nothing will come any more, and nothing has a place from then on."""
        asked, end = self.asked, partial(super().end, now, at)
        tick = end() if asked is None else self._answering(asked, end)
        if tick is not None:
            self._keep_tick(tick, tick.step.stamp)
            self.keeping.close(tick.step.stamp)
        return tick

    @property
    def _until(self) -> int:
        return max(self.newest, self._deadline)  # what was judged since changed nothing, and a restored judge lacks it

    def _keep_tick(self, tick: Judged, time: int) -> None:
        """Keep a deadline that is told for the first time."""
        self._deadline = max(self._deadline, time)
        self._keep(tick, key_of(time, tick=True), time)

    def _judge_first(self, step: Step, now: int, *, placed: bool = False, level: int = 0) -> Judged:
        """Judge a step for the first time: in its place, or behind all others, and deadlines up to a `level` (ns)."""
        if self.recurring is not None:
            now = self.recurring()
        counters = self.counters
        steps = counters.steps
        self._recent.number, self._placing = self._numbered + 1, placed
        judged = self.judge(step, now)
        self._placing = False
        undone = counters.steps == steps
        self._numbered += not undone
        if placed:
            number = None if undone else self._numbered
            judged = msgspec.structs.replace(judged, number=number, place=steps + 1)
            self._renumber(judged)
        if step.skipped:
            self._position = self._position_of(judged)
        elif placed or (not step.late and self.plan.streams[step.event.stream].spec.ordered):
            time = step.time
            self._keep(judged, 2 * time, time - 1, undone=undone)  # as `key_of`, without a call for nearly all steps
        else:
            level = self._deadline = max(self._deadline, level)
            self._keep(judged, self._key_behind(level), level, undone=undone)
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
        self._not_before, self._recent.number = row.present, row.judged.number
        self._placing = row.judged.place is not None
        asked = None if self.asked is None or self.asked.position != row.position else self._states[self.asked.prop]
        if asked is not None:
            asked.asked = True
        if row.undone:
            before = self._attempt()
            judged = self._take_back(self._judge(row.step, row.judged.judged, revisable=True), before)
        else:
            judged = self._judge(row.step, row.judged.judged)
        self._not_before, self._numbers, self._degraded, self.counters.denied = 0, numbers, degraded, denied
        self._placing = False
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
        self._keep(stands, row.key, row.level, undone=row.undone, old=row)

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
        self._stand_as_last(row.noted for row in taken)
        self._rewritten = Rewritten(self.following, self.plan.spec.gap, reversed(taken))
