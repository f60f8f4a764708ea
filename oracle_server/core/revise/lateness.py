"""What comes late in a session that revises: events that come together are put in place together."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec

from oracle_server.core.events import Step
from oracle_server.core.revise.saving import SavableJudge
from oracle_server.core.verdicts import Judged

TOGETHER = 10**7
"""How long (ns) a late event waits for others, unless it asks: a burst costs one pass."""


class Lateness:
    """Gives a judge the steps that the order releases, and those that are late together."""

    def __init__(self, judge: SavableJudge) -> None:
        self.judge = judge
        self.placed = 0
        """How many late events were put in their places."""
        self.beyond = 0
        """How many were older than the horizon, and were judged at the present."""
        self.passes = 0
        self._waiting: list[Step] = []
        self.due: int | None = None
        """When those that wait are to be put in their places (ns), None while none waits."""

    @property
    def waiting(self) -> int:
        """How many late events wait to be put in their places."""
        return len(self._waiting)

    def take(self, step: Step, now: int, enough: Callable[[], bool]) -> list[Judged]:
        """Take a step as it comes: of a stream without order at once, of others as the order releases it."""
        judge = self.judge
        if not step.late and not judge.is_late(step):
            return judge.take(step, now)
        if step.skipped or not judge.plan.streams[step.event.stream].spec.ordered:
            return judge.take(step, now)
        self._wait(step, now)
        return [] if step.event.more else self.go_on(now, enough)  # an event's rows go into one pass, or none is whole

    def go_on(self, now: int, enough: Callable[[], bool]) -> list[Judged]:
        """Go on with what is put in place, and begin with what has waited for it.

        There is nothing to do while none is `due`, no pass goes on, and no deadline is `unknown`.
        """
        outputs = self.judge.say_unsaid(now)
        outputs += self._pass(now, enough)
        while self.due is not None and self.due <= now and not self.judge.is_going:
            outputs += self._begin(now)
            outputs += self._pass(now, enough)
        return outputs

    def _wait(self, step: Step, now: int) -> None:
        """Let a late step wait for others; one that asks waits for none."""
        self._waiting.append(msgspec.structs.replace(step, late=True))
        if self.due is None:
            self.due = now + TOGETHER
        if step.event.ask:
            self.due = now

    def _pass(self, now: int, enough: Callable[[], bool]) -> list[Judged]:
        """Go on with a pass, if one goes on, and let wait what is late since it began."""
        outputs = self.judge.go_on(now, enough) if self.judge.is_going else []
        overtaken, self.judge.overtaken = self.judge.overtaken, []
        for step in overtaken:
            self._wait(step, now)
        return outputs

    def expire(self, now: int) -> None:
        """Let what is late wait no longer for others."""
        self.due = now if self._waiting else None

    def finish(self, now: int) -> list[Judged]:
        """Put all in place now."""
        self.expire(now)
        return self.go_on(now, lambda: False)

    def _begin(self, now: int) -> list[Judged]:
        late, self._waiting, self.due = self._waiting, [], None
        placed, outputs = late, list[Judged]()
        while beyond := [step for step in placed if not self.judge.has_place(step)]:  # what is judged may take a place
            placed = [step for step in placed if self.judge.has_place(step)]
            self.beyond += _events(beyond)
            self.judge.degrade()
            for step in beyond:
                outputs += self.judge.take(step, now)
        self.placed += _events(placed)
        if placed:
            self.passes += 1
            self.judge.place(placed)
        return outputs


def _events(steps: Iterable[Step]) -> int:
    """How many events steps are of: of those with rows the first one counts."""
    return sum(not step.event.row for step in steps)
