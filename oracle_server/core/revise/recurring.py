"""What a session that revises said, said again: the rows of its trace, in the sequence in which they were judged."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from typing import NamedTuple

from oracle_server.core.events import ENDED, Step
from oracle_server.core.kinds import TICK
from oracle_server.core.revise.judge import RevisingJudge
from oracle_server.core.revise.kept import MOST
from oracle_server.core.verdicts import Judged


class Row(NamedTuple):
    """A recorded row: where it was in the sequence, when it was judged (ns), and whether it was put in its place.

    `degraded`: something before it was known to be lost; `bypassed` are the properties, by their indexes, of which a
    stream was bypassed then.
    """

    position: int
    step: Step
    judged: int
    placed: bool
    degraded: bool = False
    bypassed: Collection[int] = ()

    @property
    def is_tick(self) -> bool:
        """Whether it is a deadline."""
        return self.step.event.stream.kind == TICK


class Recurring:
    """Gives a judge the rows of a trace: late events that were put in their places together come together again.

    They are next to each other in the sequence, with the deadlines that were judged then, and with what had come before
    they all were judged; the revisions, which a trace does not have, leave a gap behind them. Where there were none, no
    gap tells the end of a pass: it ends after `MOST` rows then.
    """

    def __init__(self, judge: RevisingJudge) -> None:
        self._judge = judge
        judge.recurring = self._recall
        self._pass: list[Row] = []
        """The rows of a pass, which a late event begins."""
        self._rows: Sequence[Row] = ()
        """The rows that are judged now."""
        self._last = 0
        self._told: Counter[int] = Counter()
        """The deadlines that were judged before their own rows came."""

    def take(self, row: Row) -> list[Judged]:
        """Judge a row again; those of a pass once the next row is none of it."""
        ends = row.is_tick and row.step.event.source == ENDED
        outputs = [] if self._goes_on(row) and not ends and len(self._pass) < MOST else self.finish()
        self._last = row.position
        if row.placed or self._pass:
            self._pass.append(row)
            return outputs
        self._rows = (row,)
        if ends:
            ended = self._judge.end(row.judged)
            return outputs if ended is None else [*outputs, ended]
        if not row.is_tick:
            return outputs + self._judge.take(row.step, row.judged)
        if self._told[row.step.stamp] > 0:
            self._told[row.step.stamp] -= 1
            return outputs
        return outputs + self._judge.tick_until(row.step.stamp, row.judged, _never)[0]

    def _goes_on(self, row: Row) -> bool:
        """Whether a row is one of the same pass as the last one, as far as that can be told.

        What is late and was put in its place together had come before these were judged then, and is judged behind
        them, and behind the deadlines between.
        """
        if not self._pass or row.position != self._last + 1 or not row.placed:
            return row.position == self._last + 1
        last = self._pass[-1]
        level = max((each.step.stamp for each in self._pass if each.is_tick), default=0)
        late = [each for each in self._pass if each.placed]
        between = any(not (each.placed or each.is_tick) for each in self._pass)
        together = late[-1].step.time <= row.step.time > level and row.step.event.arrived <= last.judged
        return together and not between

    def finish(self) -> list[Judged]:
        """Judge the rows of a pass."""
        rows, self._pass = self._pass, []
        if not rows:
            return []
        behind = next((i for i, row in enumerate(rows) if not (row.placed or row.is_tick)), len(rows))
        level = max((row.step.stamp for row in rows[:behind] if row.is_tick), default=0)
        self._judge.place([row.step for row in rows[:behind] if row.placed], level)
        for row in rows[behind:]:
            if row.is_tick:
                self._judge.tick_until(row.step.stamp, row.judged, _never)
            else:
                self._judge.take(row.step, row.judged)
        self._rows = rows
        outputs = self._judge.go_on(rows[-1].judged, _never)
        self._told.update(row.step.stamp for row in outputs if row.step.event.stream.kind == TICK)
        self._told.subtract(row.step.stamp for row in rows if row.is_tick)
        return outputs

    def _recall(self) -> int:
        """Bring back how the row that is judged next was said, and when (ns)."""
        row = self._rows[min(self._judge.said, len(self._rows) - 1)]
        self._judge.recall(row.degraded, row.bypassed)
        return row.judged


def _never() -> bool:
    return False
