"""A judge that revises, saved and restored: as of before the first row that it keeps, and by the rows after that."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Collection, Iterator, Sequence
from operator import attrgetter

import msgspec

from oracle_server.core.engine import Engine
from oracle_server.core.events import ENDED, Order, Step
from oracle_server.core.judging.deciding import is_denied
from oracle_server.core.kinds import TICK
from oracle_server.core.plan import Plan
from oracle_server.core.revise.episodes import rename, renamed, rewritten
from oracle_server.core.revise.judge import RevisingJudge
from oracle_server.core.revise.kept import Keeping, Kept, key_of
from oracle_server.core.revise.queued import Until
from oracle_server.core.revise.ticks import Identity
from oracle_server.core.revisions import Revision
from oracle_server.core.snapshot import RevisingSnapshot
from oracle_server.core.verdicts import Judged, Outcome

_BEGINNING = -1
"""A time (ns) before all others."""
_TOGETHER = 1_000
"""Recorded rows that are judged again together: what stands behind several late ones is judged once for all."""


class SavableJudge(RevisingJudge):
    """A `RevisingJudge` that can be saved, and restored."""

    def __init__(self, plan: Plan, engines: Sequence[Engine], order: Order, numbers: Iterator[int]) -> None:
        """As every `RevisingJudge`."""
        super().__init__(plan, engines, order, numbers)
        self._restoring = False
        self.together = _TOGETHER
        """How many recorded rows are judged again together at most."""
        self._counted = 0
        """Up to which position a snapshot has counted: what is judged again of that is not counted again."""
        self._lost = False
        """Whether it is degraded behind that position."""
        self._gathered: list[Kept] = []
        """Recorded steps in order, and late ones with a place, that are to be judged again together."""
        self.unknown = 0
        """Deadlines that were judged again before their rows came, which then tell their positions; counted down."""
        self._early: dict[Identity, tuple[Step, int]] = {}
        """Rows of deadlines that are judged only with a late event whose row comes next in the pass."""

    def save(self) -> RevisingSnapshot | None:
        """All that later verdicts depend on, as of before the first row that is kept; None where it can't be saved.

        It goes back for that, and begins a pass that judges the kept rows again. No pass may go on.
        """
        self.forget()
        rows = list(self.keeping)
        self._begin_pass()
        self._go_back(self.keeping.after(_BEGINNING))
        states = self.snapshot()
        self.ahead.extend(row for row in rows if not row.is_tick)
        self.ahead.append(Until(self._level))
        if states is None:
            return None
        first = min((row.position for row in rows), default=self._position + 1)
        placed = (row.is_tick or row.judged.place is not None or self._is_placed(row.step) for row in rows)
        behind = [row.level for row, is_placed in zip(rows, placed, strict=True) if not is_placed]
        self.keeping.placed = [position for position in self.keeping.placed if position >= first]
        if rows:
            states["degraded"] = all(v.degraded and not v.bypassed for v in rows[0].judged.verdicts)
        return {
            "judge": states,
            "position": first - 1,
            "included": list(self.keeping.placed),
            "floor": self.keeping.floor,
            "deadline": min(behind, default=self._deadline),
            "before": self.keeping.base.before,
            "numbered": self._numbered,
            "counted": self._next_position() - 1,
            "degraded": self._degraded,
            "finals": [(state.final, state.final_since, state.said) for state in self._states],
            "beneath": True,
        }

    def load(self, data: RevisingSnapshot, numbers: Iterator[int]) -> None:
        """Take over what `save` gave; verdicts are numbered from `numbers`. Raises `EngineError`."""
        self.restore(data["judge"], numbers)
        for state, engine, (final, since, said) in zip(self._states, self._engines, data["finals"], strict=True):
            state.final, state.final_since, state.said = None if final is None else Outcome(final), since, said
            if state.said and not data.get("beneath", False):
                state.stop_beneath()
            if state.broken is None and state.is_asked:
                engine.record()
        self.keeping = Keeping(self.horizon, self._point(data["before"]), floor=data["floor"])
        self.keeping.placed = list(data["included"])
        self._derived.noted()
        self._numbered, self.newest, self._position = data["numbered"], self.present, data["position"]
        self._deadline, self._counted = data["deadline"], data.get("counted", sys.maxsize)
        self._lost = data.get("degraded", False)

    def _next_position(self) -> int:
        n = next(self._numbers)
        self._numbers = itertools.count(n)
        return (n - 1) // len(self.properties) + 1

    def rejudge(self, recorded: Judged, position: int) -> None:
        """Judge a recorded row again, at its position, in the sequence in which the rows were said.

        It is decided as it was. Steps in order, and late ones that have a place, wait for others: what stands does not
        depend on when they come. `finish_again` judges what waits.
        """
        kind = recorded.step.event.stream.kind
        if self.ticking and kind != TICK and recorded.place is None:  # a pass has ended, and the deadlines of it
            if any(row.judged.place is not None for row in self._gathered):
                self.finish_again()
            self._early = {}
        if not isinstance(recorded, Revision):  # the rows that one changed are as they stand
            self._judge_recorded(recorded, position)
            self._position = position
        self._count_again(recorded, position)
        self._restoring = False
        self._numbered = max(self._numbered, recorded.number or 0)
        self._numbers = itertools.count(position * len(self.properties) + 1)

    def _judge_recorded(self, recorded: Judged, position: int) -> None:
        step = recorded.step
        if step.event.stream.kind == TICK:
            self.finish_again()
            self._restoring = step.event.source != ENDED
            if self._restoring:
                self._tick_again(step, recorded.judged, position)
            else:
                self.end(recorded.judged)
                self.counters.ticks = max(self.counters.ticks, step.event.seq)
        elif step.skipped:
            self.degrade()
        elif position not in self.keeping.placed:
            if step.event.lost or step.forced:
                self.degrade()
            self._step_again(recorded, position)

    def _count_again(self, recorded: Judged, position: int) -> None:
        if position <= self._counted:
            return
        if isinstance(recorded, Revision):
            self._count_changes([recorded])
        elif recorded.step.event.monitor:
            self._count(recorded.step)
            self.counters.skipped += recorded.step.skipped and not recorded.step.event.row
            self.counters.denied += is_denied(recorded.decision)

    def finish_again(self) -> None:
        """Judge the recorded steps that wait for others."""
        rows, self._gathered = sorted(self._gathered, key=lambda row: row.key), []
        if not rows:
            return
        numbers, self._restoring = self._numbers, True
        taken = self.keeping.after(rows[0].step.time)
        self._begin_pass()
        self._go_back(taken)
        known = [row for row in reversed(taken) if not row.is_tick]
        merged: list[Kept] = sorted([*known, *rows], key=lambda row: row.key)  # of one key, those of before first
        self.ahead.extend(merged)
        self.ahead.append(Until(max(self._level, rows[-1].level)))
        self.go_on(max(row.judged.judged for row in rows), _never)
        self._numbers, self._restoring = numbers, False

    def end_restoring(self) -> None:
        """Behind the last recorded row: judge what waits, and know of what was lost by the snapshot."""
        self.finish_again()
        if self._lost:
            self.degrade()

    def degrade(self) -> None:
        """See `Judge.degrade`; what was judged before is not degraded."""
        if not self._degraded:
            self.finish_again()
        super().degrade()

    def bypass(self, properties: Collection[int]) -> None:
        """See `Judge.bypass`; what was judged before is not degraded."""
        if any(state.bypassed is not (i in properties) for i, state in enumerate(self.properties)):
            self.finish_again()
        super().bypass(properties)

    def say_unsaid(self, now: int) -> list[Judged]:
        """After a restore: the deadlines that were judged again, and are in no row; they are said now."""
        unsaid = [row for row in self.keeping if row.position <= 0] if self.unknown else []
        self.unknown = 0
        for row in unsaid:
            position = self._next_position()
            self._numbers = itertools.count(position * len(self.properties) + 1)
            self.counters.ticks += 1
            event = msgspec.structs.replace(row.step.event, seq=self.counters.ticks, arrived=now)
            self._say(row, msgspec.structs.replace(row.step, event=event), position)
            self._position, self._deadline = position, max(self._deadline, row.step.stamp)
        if not unsaid:
            return []
        known = rewritten(self.keeping.base.following, self.plan.spec.gap, list(self.keeping), unsaid)
        return known.told([row.judged for row in unsaid], self.following)

    def _step_again(self, recorded: Judged, position: int) -> None:
        """A recorded step, in its place where it was put there."""
        step = recorded.step
        undone = self.plan.streams[step.event.stream].undoes and is_denied(recorded.decision)
        last = self.keeping.last
        row = Kept(
            0, last.before, last.ticked, last.outdated, last.steps, last.held, last.properties, last.following,
            recorded, key_of(step.time), step.time - 1, position, self._position, undone,
        )  # fmt: skip
        if recorded.place is not None or self._is_placed(step):
            self._gathered.append(row)
            if len(self._gathered) >= self.together:
                self.finish_again()
            return
        self.finish_again()
        self._restoring = True
        self._judge_deadlines(self._deadline, recorded.judged)
        self._deadline = self._level_behind(step, again=True)
        self._judge_deadlines(self._deadline, recorded.judged)
        if recorded.number == 1:  # it moved the present, which late ones that stand before it have moved less far
            row.present = min(step.time, step.event.arrived)
        row.key = max(self.keeping.key, key_of(row.present), self._key_behind(self._deadline))
        row.level = self._deadline
        self._judge_again(row)
        self._stands.clear()

    def _tick_again(self, step: Step, now: int, position: int) -> None:
        """A recorded deadline: it may have been judged already, with what came late before it was said."""
        row = self._unknown_tick(step)
        if row is None:
            self._judge_deadlines(step.stamp, now)
            row = self._unknown_tick(step)
        self.counters.ticks = max(self.counters.ticks, step.event.seq)
        self._deadline = max(self._deadline, step.stamp)
        if row is not None:
            self._say(row, step, position)
        else:
            self._early[self._old_ticks.identity(step)] = step, position

    def _unknown_tick(self, step: Step) -> Kept | None:
        """A deadline that was judged again, and whose row, with this step, has not come yet: the first of several."""
        rows = itertools.takewhile(lambda row: row.key >= key_of(step.stamp), reversed(self.keeping.rows))
        identity = self._old_ticks.identity
        found = [row for row in rows if row.position <= 0 and identity(row.step) == identity(step)]
        return max(found, key=attrgetter("position"), default=None)

    def _end(self, now: int) -> list[Judged]:
        if self._restoring:  # what is retracted may come again with another late event of the same pass
            gone = [row for row in self._old_ticks if row.position > 0]
            self._early |= {self._old_ticks.identity(row.step): (row.step, row.position) for row in gone}
        return super()._end(now)

    def _say(self, row: Kept, step: Step, position: int) -> None:
        """Give a deadline the position and the numbers of its row."""
        begin = (position - 1) * len(self.properties) + 1
        verdicts = [msgspec.structs.replace(v, n=begin + i) for i, v in enumerate(row.judged.verdicts)]
        names = {old.n: new.n for old, new in zip(row.judged.verdicts, verdicts, strict=True)}
        for state in self.properties:
            state.first_violation = names.get(state.first_violation or 0, state.first_violation)
        self.following = renamed(self.following, names)
        row.judged = msgspec.structs.replace(row.judged, step=step, verdicts=tuple(verdicts))
        row.position, row.preceding = position, self._position
        rename(itertools.takewhile(lambda kept: kept is not row, reversed(self.keeping.rows)), names)
        rename([row], names)
        self.keeping.last = self.keeping.rows[-1]
        if self.asked is not None and self.asked.position == position:
            self.answer = row.judged

    def _judge_deadline(self, time: int, now: int) -> Judged | None:
        if not self._restoring:
            return super()._judge_deadline(time, now)
        numbers, ticks = self._numbers, self.counters.ticks
        self._numbers = itertools.count((self.unknown - 1) * len(self.properties) + 1)
        tick = super()._judge_deadline(time, now)
        self._numbers, self.counters.ticks = numbers, ticks
        return tick

    def _keep_tick(self, tick: Judged, time: int) -> None:
        deadline = self._deadline
        super()._keep_tick(tick, time)
        if not self._restoring:
            return
        self._deadline = deadline  # until its row comes
        self.unknown -= 1
        known = self._early.pop(self._old_ticks.identity(tick.step), None)
        if known is not None:
            self._say(self.keeping.rows[-1], *known)


def _never() -> bool:
    return False
