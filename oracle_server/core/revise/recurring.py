"""What a session that revises said, said again: the rows of its trace, in the sequence in which they were judged."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from oracle_server.core.events import ENDED, Step
from oracle_server.core.kinds import TICK
from oracle_server.core.revise.judge import RevisingJudge
from oracle_server.core.verdicts import Judged


class Row(NamedTuple):
    """A recorded row: where it was in the sequence, when it was judged (ns), and whether it was put in its place."""

    position: int
    step: Step
    judged: int
    placed: bool


class Recurring:
    """Gives a judge the rows of a trace: late events that were put in their places together come together again.

    They are next to each other in the sequence, with the deadlines that were judged then, and the revisions, which a
    trace does not have, leave a gap behind them.
    """

    def __init__(self, judge: RevisingJudge) -> None:
        self._judge = judge
        judge.recurring = True
        self._late: list[Row] = []
        self._level = 0
        """The latest deadline (ns) that was judged with them, 0 where none was."""
        self._last = 0
        self._told: Counter[int] = Counter()
        """The deadlines that were judged before their own rows came."""

    def take(self, row: Row) -> list[Judged]:
        """Judge a row again; late events once the next row is none of theirs."""
        is_tick = row.step.event.stream.kind == TICK
        if is_tick and row.step.event.source == ENDED:
            outputs, ended = self.finish(), self._judge.end(row.judged)
            return outputs if ended is None else [*outputs, ended]
        apart = row.position != self._last + 1 or not (is_tick or self._is_together(row))
        outputs = self.finish() if apart else []
        self._last = row.position
        if row.placed:
            self._late.append(row)
            return outputs
        if not is_tick:
            return outputs + self._judge.take(row.step, row.judged)
        if self._late:
            self._level = max(self._level, row.step.stamp)
            self._told[row.step.stamp] -= 1
        elif self._told[row.step.stamp] > 0:
            self._told[row.step.stamp] -= 1
        else:
            outputs += self._judge.tick_until(row.step.stamp, row.judged, _never)[0]
        return outputs

    def _is_together(self, row: Row) -> bool:
        """Whether a row, if it is a late event, was put in its place together with the last ones.

        It had come before these were judged then, and is judged behind them, and behind the deadlines between.
        """
        if not row.placed or not self._late:
            return row.placed
        last = self._late[-1]
        return row.step.event.arrived <= last.judged and last.step.time <= row.step.time > self._level

    def finish(self) -> list[Judged]:
        """Put in their places what was late together."""
        late, self._late = self._late, []
        level, self._level = self._level, 0
        if not late:
            return []
        now = late[-1].judged
        self._judge.place([row.step for row in late], level)
        outputs = self._judge.go_on(now, _never)
        self._told.update(row.step.stamp for row in outputs if row.step.event.stream.kind == TICK)
        return outputs


def _never() -> bool:
    return False
