"""A judge that revises, saved and restored: as of before the first row that it keeps, and by the rows after that."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import msgspec

from oracle_server.core.deciding import is_denied
from oracle_server.core.engine import Engine
from oracle_server.core.events import Order, Step
from oracle_server.core.kinds import TICK
from oracle_server.core.plan import Plan
from oracle_server.core.revise.judge import RevisingJudge, Until, rewindable
from oracle_server.core.revise.kept import Keeping, Kept, key_of
from oracle_server.core.revisions import Revision
from oracle_server.core.snapshot import RevisingSnapshot
from oracle_server.core.verdicts import Judged, Outcome

_BEGINNING = -1
"""A time (ns) before all others."""


class SavableJudge(RevisingJudge):
    """A `RevisingJudge` that can be saved, and restored."""

    def __init__(self, plan: Plan, engines: Sequence[Engine], order: Order, numbers: Iterator[int]) -> None:
        """As every `RevisingJudge`."""
        super().__init__(plan, engines, order, numbers)
        self._restoring = False
        self._unknown = 0
        """Deadlines that were judged again before their rows came, which then tell their positions; counted down."""
        self._early: dict[int, tuple[Step, int]] = {}
        """Rows of deadlines, by time (ns), that are judged only with a late event whose row comes next in the pass."""

    def save(self) -> RevisingSnapshot | None:
        """All that later verdicts depend on, as of before the first row that is kept; None where it can't be saved.

        It goes back for that, and begins a pass that judges the kept rows again. No pass may go on.
        """
        rows = list(self.keeping)
        self._begin_pass()
        self._go_back(self.keeping.after(_BEGINNING))
        states = self.snapshot()
        self._ahead.extend(row for row in rows if not row.is_tick)
        self._ahead.append(Until(self._level))
        if states is None:
            return None
        first = min((row.position for row in rows), default=self._position + 1)
        self.keeping.placed = [position for position in self.keeping.placed if position >= first]
        if rows:
            states["degraded"] = all(verdict.degraded for verdict in rows[0].judged.verdicts)
        return {
            "judge": states,
            "position": first - 1,
            "included": list(self.keeping.placed),
            "floor": self.keeping.floor,
            "before": self.keeping.base.before,
            "numbered": self._numbered,
            "finals": [(state.final, state.final_since, state.said) for state in self._states],
        }

    def load(self, data: RevisingSnapshot, numbers: Iterator[int]) -> None:
        """Take over what `save` gave; verdicts are numbered from `numbers`. Raises `EngineError`."""
        self.restore(data["judge"], numbers)
        for state, (final, since, said) in zip(self._states, data["finals"], strict=True):
            state.final, state.final_since, state.said = None if final is None else Outcome(final), since, said
            if state.broken is None and not state.said:
                rewindable(state.engine).record()
        self.keeping = Keeping(self.horizon, self._point(None)._replace(before=data["before"]))
        self.keeping.floor, self.keeping.placed = data["floor"], list(data["included"])
        self._numbered, self.newest, self._position = data["numbered"], self.present, data["position"]

    def rejudge(self, recorded: Judged, position: int) -> Judged | None:
        """Judge a recorded row again, at its position, in the sequence in which the rows were said.

        It is decided as it was. Returns how it stands then; None for a revision, for a deadline that is not judged any
        more, for a step that was skipped, and for one that was loaded.
        """
        step, kind = recorded.step, recorded.step.event.stream.kind
        self._restoring = True
        if kind != TICK and recorded.place is None:
            self._early = {}
        if isinstance(recorded, Revision):
            self._count_changes([recorded])
        elif kind == TICK:
            self._tick_again(step, recorded.judged, position)
        elif step.skipped:
            self.counters.skipped += 1
            self.degrade()
        elif position not in self.keeping.placed:
            self._count(step)
            self.counters.denied += is_denied(recorded.decision)
            self._step_again(recorded, position)
        self._restoring = False
        self._numbered = max(self._numbered, recorded.number or 0)
        self._numbers = itertools.count(position * len(self.properties) + 1)
        if isinstance(recorded, Revision):
            return None
        self._position = position
        return next((row.judged for row in reversed(self.keeping.rows) if row.position == position), None)

    def say_unsaid(self, now: int) -> list[Judged]:
        """After a restore: the deadlines that were judged again, and are in no row; they are said now."""
        unsaid = [row for row in self.keeping if row.position <= 0] if self._unknown else []
        self._unknown = 0
        for row in unsaid:
            position = (next(self._numbers) - 1) // len(self.properties) + 1
            self._numbers = itertools.count(position * len(self.properties) + 1)
            self.counters.ticks += 1
            event = msgspec.structs.replace(row.step.event, seq=self.counters.ticks, arrived=now)
            self._say(row, msgspec.structs.replace(row.step, event=event), position)
            self._position = position
        return [row.judged for row in unsaid]

    def _step_again(self, recorded: Judged, position: int) -> None:
        """A recorded step, in its place where it was put there."""
        step, placed = recorded.step, recorded.place is not None
        in_order = placed or (self._is_ordered(step) and not step.late)
        if not in_order:  # up to when its deadlines had waited long enough
            waited = step.event.arrived - max(1, self.plan.spec.ordering.max_delay or 0)
            self._judge_deadlines(max(self._level, waited), recorded.judged)
        present = self.present or min(step.time, step.event.arrived)  # as where it was judged first
        undoes = self.plan.streams[step.event.stream].undoes
        row = Kept(
            recorded,
            key_of(step.time) if in_order else max(self.keeping.key, key_of(present), self._key_behind(self._deadline)),
            step.time - 1 if in_order else self._deadline,
            position,
            self._position,
            self.keeping.last._replace(present=0),
            undone=undoes and is_denied(recorded.decision),
        )
        taken = self.keeping.after(step.time) if placed else []
        if not taken:
            self._judge_deadlines(row.level, recorded.judged)
            self._judge_again(row)
            self._judge_deadlines(self._level if placed else row.level, recorded.judged)
            self._stands.clear()
            return
        self._begin_pass()
        self._go_back(taken)
        self._ahead.append(row)
        self._ahead.extend(again for again in reversed(taken) if not again.is_tick)
        self._ahead.append(Until(self._level))
        self.go_on(recorded.judged, _never)

    def _tick_again(self, step: Step, now: int, position: int) -> None:
        """A recorded deadline: it may have been judged already, with what came late before it was said."""
        row = self._unknown_tick(step.stamp)
        if row is None:
            self._judge_deadlines(step.stamp, now)
            row = self._unknown_tick(step.stamp)
        self.counters.ticks = max(self.counters.ticks, step.event.seq)
        if row is not None:
            self._say(row, step, position)
        else:
            self._early[step.stamp] = step, position

    def _unknown_tick(self, time: int) -> Kept | None:
        """A deadline at a time (ns) whose row has not come yet."""
        rows = itertools.takewhile(lambda row: row.key >= key_of(time), reversed(self.keeping.rows))
        return next((row for row in rows if row.position <= 0 and row.step.stamp == time), None)

    def _end(self, now: int) -> list[Judged]:
        if self._restoring:  # what is retracted may come again with another late event of the same pass
            gone = (row for rows in self._old_ticks.values() for row in rows if row.position > 0)
            self._early |= {row.step.stamp: (row.step, row.position) for row in gone}
        return super()._end(now)

    def _say(self, row: Kept, step: Step, position: int) -> None:
        """Give a deadline the position and the numbers of its row."""
        begin = (position - 1) * len(self.properties) + 1
        verdicts = [msgspec.structs.replace(v, n=begin + i) for i, v in enumerate(row.judged.verdicts)]
        renamed = {old.n: new.n for old, new in zip(row.judged.verdicts, verdicts, strict=True)}
        for state in self.properties:
            state.first_violation = renamed.get(state.first_violation or 0, state.first_violation)
        row.judged = msgspec.structs.replace(row.judged, step=step, verdicts=tuple(verdicts))
        row.position, row.preceding = position, self._position

    def _judge_new_deadline(self, time: int, now: int) -> Judged | None:
        if not self._restoring:
            return super()._judge_new_deadline(time, now)
        numbers, self._numbers = self._numbers, itertools.count((self._unknown - 1) * len(self.properties) + 1)
        tick = super()._judge_new_deadline(time, now)
        self._numbers = numbers
        if tick is not None:
            self._unknown -= 1
            if time in self._early:
                self._say(self.keeping.rows[-1], *self._early.pop(time))
        return tick


def _never() -> bool:
    return False
