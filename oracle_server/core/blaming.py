"""The part of a judge that decides events by the outcomes of their guards."""

from __future__ import annotations

from collections.abc import Sequence

from oracle_server.core.deciding import denies
from oracle_server.core.events import Step
from oracle_server.core.holding import Held
from oracle_server.core.plan import StreamPlan
from oracle_server.core.telling import Telling
from oracle_server.core.verdicts import NEGATIVE, Decision, Outcome

NO_ONE = frozenset[int]()


class Blaming(Telling):
    """Decisions, and which guards blame an event."""

    _held: dict[str, Held]

    def _blameless(self, step: Step, stream: StreamPlan) -> frozenset[int]:
        """The guards with `blame: caused` that would be negative without the event too."""
        if not (self._decides and step.event.ask):
            return NO_ONE
        held = self._held.get(step.event.monitor, Held())
        signals, failed = self._derived.at(self.present, self.counters.steps, held.values, held.failed)
        return frozenset(
            i
            for i in stream.blames
            if self.properties[i].silent(self.plan.silent[i], self.present, signals, failed) in NEGATIVE
        )

    def _decide(self, step: Step, outcomes: Sequence[Outcome], blameless: frozenset[int] = NO_ONE) -> Decision | None:
        """The decision on an event, by the outcomes of all properties; None where none is wanted."""
        if not (step.event.ask and self._decides):
            return None
        guards = self.plan.streams[step.event.stream].guards
        states = self.properties
        denying = [i for i in guards if denies(outcomes[i], blamed=i not in blameless, breaks=states[i].breaks)]
        denied_by = tuple(states[i].property.id for i in denying)
        return Decision("deny" if denied_by else "allow", denied_by)
