"""What a session is restored by: its snapshot, and what was judged after it, judged again."""

from __future__ import annotations

import itertools
from collections import defaultdict

from oracle_server.core.asking import Asking
from oracle_server.core.events import ENDED, Order, Source, Step, StreamKey
from oracle_server.core.judging.judge import Judge
from oracle_server.core.kinds import TICK
from oracle_server.core.ordering.reorder import ReorderBuffer
from oracle_server.core.plan import Plan
from oracle_server.core.revise.lateness import Lateness
from oracle_server.core.rows import Rows
from oracle_server.core.snapshot import SessionSnapshot
from oracle_server.core.tally import StreamCounts
from oracle_server.core.verdicts import Judged


class Resumable:
    """The part of a session that judges again what was judged before."""

    plan: Plan
    judges: dict[Order, Judge]
    buffer: ReorderBuffer[Step]
    counts: defaultdict[Source, StreamCounts]
    lateness: Lateness | None
    asking: Asking | None
    rows: Rows
    now: int

    def rejudge(self, order: Order, step: Step, judged: int) -> Judged | None:
        """Judge again what was judged before, in the same sequence, to restore a session.

        None where a tick changed an outcome then, and does not now.
        """
        if step.event.stream.kind == TICK:
            self.now = max(self.now, judged)
            judge = self.judges[order]
            ended, number = step.event.source == ENDED, step.event.seq
            again = judge.end(judged, step.stamp) if ended else judge.tick(step.stamp, judged, step.signals)
            judge.counters.ticks = max(judge.counters.ticks, number)  # each number stands in the history once
            return again
        if order == "publication" and not step.late and self.plan.spec.by_key[step.event.stream].ordered:
            self.buffer.present = step.time
        self.now = max(self.now, judged)
        if step.event.lost:
            self.note_loss()
        return self.judges[order].judge(step, judged)

    def rejudge_row(self, recorded: Judged, position: int) -> None:
        """The same, where the spec revises: a recorded row at its position; see `SavableJudge.rejudge`.

        `finish_again` is called behind the last one.
        """
        assert self.lateness is not None  # noqa: S101 -- only called where it does
        self.note_again(recorded.step, recorded.judged)
        if recorded.step.event.lost:
            self.note_loss()
        self.lateness.judge.rejudge(recorded, position)

    def finish_again(self) -> None:
        """Where the spec revises: judge what of the recorded rows waits for others; behind the last one."""
        if self.lateness is not None:
            self.lateness.judge.end_restoring()

    def note_again(self, step: Step, judged: int) -> None:
        """Note of a recorded row that is judged again, where the spec revises, what does not concern its judge."""
        self.now = max(self.now, judged)
        if step.event.monitor and not step.late and self.plan.spec.by_key[step.event.stream].ordered:
            self.buffer.present = step.time

    @property
    def can_be_saved(self) -> bool:
        """Whether a snapshot may be taken now: no oracle is asked, nothing is judged again, and no row waits.

        Nor may some of the deadlines at one time wait. After a restart, deadlines that are in no row are said first: a
        snapshot is as of before a row.
        """
        judge = None if self.lateness is None else self.lateness.judge
        if any(each.is_ticking or each.is_deciding for each in self.judges.values()):
            return False
        return not (self.asking or self.rows) and (judge is None or not (judge.is_going or judge.unknown))

    def snapshot(self) -> SessionSnapshot | None:
        """All that later verdicts depend on except what is held in the order, as plain data, where it `can_be_saved`.

        None where an engine can't be saved, or where events are judged in two orders, and may be judged in one only.
        Where the spec revises, a pass has begun then, and `advance` goes on with it.
        """
        if len(self.judges) > 1:
            return None
        counts = [(m, stream, count.late, count.lost) for (m, stream), count in self.counts.items()]
        saved: SessionSnapshot = {"judges": {}, "present": self.buffer.present, "now": self.now, "counts": counts}
        if self.lateness is not None:
            revising = self.lateness.judge.save()
            return None if revising is None else {**saved, "revising": revising}
        judges = {order: found for order, judge in self.judges.items() if (found := judge.snapshot()) is not None}
        return {**saved, "judges": judges} if judges else None

    def restore(self, data: SessionSnapshot, first: int) -> None:
        """Continue from a snapshot, before the first event; verdicts are numbered from `first`.

        Raises `EngineError` where an engine can't use it.
        """
        numbers = itertools.count(first)
        if self.lateness is not None:
            self.lateness.judge.load(data["revising"], numbers)
        else:
            for order, judge in self.judges.items():
                judge.restore(data["judges"][order], numbers)
        self.buffer.present, self.now = data["present"], data["now"]
        for monitor, stream, late, lost in data["counts"]:
            self.counts[monitor, StreamKey(*stream)] = StreamCounts(late, lost)

    def give_up(self, first: int, reason: str) -> None:
        """Stop judging, for this reason; verdicts, all unknown, are numbered from `first`."""
        numbers = itertools.count(first)
        for judge in self.judges.values():
            judge.give_up(reason, numbers)

    def note_loss(self) -> None:
        """Note that events were lost, or one could not be read."""
        for judge in self.judges.values():
            judge.degrade()
