"""How a property stands where a late event may still change it: what is final is said so once none can."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec

from oracle_server.core.engine import MAX_WORK
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.judging.deciding import Mark
from oracle_server.core.judging.property_state import Names, PropertyState
from oracle_server.core.owing import NO_UNANSWERED
from oracle_server.core.plan import View
from oracle_server.core.verdicts import FINAL, Outcome

_HOLDS = Outcome.CURRENTLY_TRUE


class Stand(msgspec.Struct, frozen=True, gc=False):
    """What a property's state had after a step, and gets back where the judge goes back to that step."""

    outcome: Outcome
    negative: bool
    failures: int
    violations: int
    first_violation: int | None
    first_violation_step: int | None
    first_violation_at: int | None
    final: Outcome | None
    final_since: int
    stained: bool


@dataclass(slots=True)
class RevisableState(PropertyState):
    """A property's state, with the outcome that became final and when; it is said once that is a `horizon` (ns) ago."""

    horizon: int = 0
    final: Outcome | None = None
    final_since: int = 0
    said: bool = False
    """Whether the final outcome was said: no late event can change it any more."""
    repeated: Outcome | None = None
    """The outcome at a step that its engine can't judge again since it has failed."""
    changed: list[RevisableState] = field(default_factory=list)
    """Where it adds itself, whenever it may have come to stand otherwise; the judge's, who has one for all."""
    _marked: list[tuple[Outcome | None, int, bool]] = field(default_factory=list)

    def step(
        self,
        view: View,
        time: int,
        signals: Mapping[str, Scalar],
        failed: Names,
        latest: int = 0,
        allowed: int = MAX_WORK,
    ) -> Outcome:
        """The outcome at the next step; see `PropertyState.step`."""
        if self.repeated is not None or (self.said and not self._goes_on):  # `is_asked`, without a call
            self.work = 0
            self.changed.append(self)
            return self.repeated or self._final(time)
        self.work = self.idle_work = 0
        self.unanswered, self.is_innocent = NO_UNANSWERED, False
        if self.final is not None and self._goes_on:
            self.changed.append(self)
            self._ask_beneath(view, time, signals, failed, allowed)
            return self._final(time)
        outcome = self._ask_engine(view, time, signals, failed, allowed)
        if outcome is _HOLDS and outcome is self.outcome and self.final is None and not failed:
            return outcome  # as nearly always: nothing changes with such a step
        self.changed.append(self)
        failures = self.failures
        outcome = self._outcome_at(view, max(time, latest), failed, outcome)
        if self.final is None:
            if outcome not in FINAL:
                return outcome
            self.final, self.final_since = outcome, time
        self.failures = failures  # a final outcome does not fail
        return self._final(time)

    def tick(
        self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names, allowed: int = MAX_WORK
    ) -> Outcome:
        """The outcome at a step that is then taken back."""
        self.changed.append(self)
        if self.final is not None:
            self.settles = False
            return self.outcome
        outcome = PropertyState.tick(self, view, time, signals, failed, allowed)
        if outcome in FINAL:
            self.final, self.final_since = outcome, time
        return outcome.current

    def silent(self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names) -> Outcome:
        """The outcome at a step without signals but held ones, in the place of the next one."""
        if self.final is not None and not self._goes_on:
            return self.final.current
        return PropertyState.silent(self, view, time, signals, failed)

    def end(self) -> Outcome:
        """The outcome once nothing will come any more: what was final within the horizon is said to be."""
        outcome, self.settles = self.outcome, self.final is not None and not self.said
        if self.settles and self.final is not None:
            self.said, self.final_since = True, -1 - self.horizon  # no step of before is judged again
            self.changed.append(self)
            outcome = self.final
        if self.asked and not self.property.latch:  # why it was latched is known
            self._explain(outcome)
        return outcome

    def next_deadline(self, after: int) -> int | None:
        """When, after `after` (ns), time alone may change the outcome; None for never."""
        return PropertyState.next_deadline(self, after) if self.final is None else None

    def mark(self) -> Mark:
        """Remember how the property stands, and begin a step that may be taken back."""
        self.changed.append(self)
        self._marked.append((self.final, self.final_since, self.said))
        return PropertyState.mark(self)

    def back(self, mark: Mark, *, counts: bool = True) -> None:
        """Take the step back."""
        PropertyState.back(self, mark, counts=counts)
        self.final, self.final_since, self.said = self._marked.pop()

    def keep(self) -> None:
        """Keep the step."""
        PropertyState.keep(self)
        self._marked.pop()

    def stain(self) -> None:
        """Note that an event which was denied may count at later steps; see `PropertyState.stain`."""
        self.changed.append(self)
        self.stained = True

    @property
    def is_lost_beneath(self) -> bool:
        """Whether it is latched, and its engine can't tell any more what its formula comes to."""
        return self.property.latch and self.final is Outcome.FALSE and not self._goes_on

    @property
    def is_asked(self) -> bool:
        """Whether its engine takes every step."""
        return self._goes_on or not self.said

    def stop_beneath(self) -> None:
        """Ask its engine no more where it is latched, since that has missed steps."""
        self._goes_on = False

    def stand(self) -> Stand:
        """How it stands."""
        return Stand(
            self.outcome, self.negative, self.failures, self.violations, self.first_violation,
            self.first_violation_step, self.first_violation_at, self.final, self.final_since, self.stained,
        )  # fmt: skip

    def put(self, stand: Stand) -> None:
        """Stand as it did, but for an engine that failed since: it stays failed."""
        self.outcome, self.negative, self.failures = stand.outcome, stand.negative, stand.failures
        self.violations, self.first_violation, self.stained = stand.violations, stand.first_violation, stand.stained
        self.first_violation_step, self.first_violation_at = stand.first_violation_step, stand.first_violation_at
        if not self.said:  # what was said to be final is not taken back
            self.final, self.final_since = stand.final, stand.final_since

    def _final(self, time: int) -> Outcome:
        assert self.final is not None  # noqa: S101 -- only called where it is
        settled = time > self.final_since + self.horizon
        self.said = self.said or settled
        return self.final if settled else self.final.current
