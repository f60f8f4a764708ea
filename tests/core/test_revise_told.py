"""How a session stands for those who ask at any time: what stands, and nothing of a pass that goes on."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import astuple, dataclass, field
from typing import Any

from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Judged
from tests.core.revising import Run, case

SHOWN = ("outcome", "violations", "first_violation", "first_violation_step", "first_violation_at", "failures")


@dataclass
class Asked(Run):
    """A run that is asked how it stands whenever it has said something, and while a pass goes on."""

    before: Any = None
    asked_within: int = 0
    changes: int = 0
    told: int = 0
    retracted: int = 0
    appeared: int = field(default=0)

    def stand(self) -> Any:
        (judge,) = self.session.judges.values()
        properties, counters, following, _ = judge.told
        return [[getattr(state, name) for name in SHOWN] for state in properties], astuple(counters), following

    def take(self, judged: Iterable[Judged]) -> None:
        rows = list(judged)
        super().take(rows)
        for row in rows:
            self.told += sum(v.explanation is not None for v in row.verdicts)
            for change in row.changes if isinstance(row, Revision) else ():
                if change is not None:
                    self.changes += 1
                    self.appeared += change.violation
                    self.retracted += change.retracted
        assert self.session.lateness is not None
        if self.session.lateness.judge.is_going:
            if self.before is not None:
                assert self.stand() == self.before
                self.asked_within += 1
            self.before = self.stand()
        else:
            self.before = None


def test_nothing_is_told_of_a_pass_that_goes_on_and_what_is_counted_is_what_was_said() -> None:
    within = changes = retracted = 0
    for seed in range(150):
        rng = random.Random(seed)
        run = Asked(case(rng, rng.choice(["steps", "seconds"])), divided=True)
        run.judge(rng)
        (judge,) = run.session.judges.values()
        properties, counters, *_ = judge.told
        assert (counters.revised, counters.retracted) == (run.changes, run.retracted)
        stands = sum(len(run.book.stands(position).explanations) for position in run.book.first)
        assert sum(p.violations for p in properties) == stands == run.told + run.appeared - run.retracted
        within, changes, retracted = within + run.asked_within, changes + run.changes, retracted + run.retracted
    assert min(within, changes, retracted) > 10
