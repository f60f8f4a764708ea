"""The part of a judge that decides events by the outcomes of their guards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from oracle_server.core.events import Step, StreamKey
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.judging.deciding import denies
from oracle_server.core.judging.holding import Held, Holding
from oracle_server.core.judging.lingering import Trace, trace
from oracle_server.core.judging.telling import Telling
from oracle_server.core.plan import StreamPlan
from oracle_server.core.verdicts import NEGATIVE, Decision, Outcome

NO_ONE = frozenset[int]()
_NOTHING: Mapping[str, Scalar] = {}


class Blaming(Telling):
    """Decisions, and which guards blame an event."""

    _held: Holding

    def __init__(self) -> None:
        self._silence = _NOTHING
        """The signals of the step without the present event."""
        self._traces: dict[StreamKey, dict[int, Trace]] = {}
        """What a stream's events leave behind for the properties that guard it and blame; worked out where wanted."""

    def _blameless(self, step: Step, stream: StreamPlan) -> frozenset[int]:
        """The guards with `blame: caused` that would be negative without the event too."""
        if not (self._decides and step.event.ask):
            return NO_ONE
        held = self._held.of(step.event.monitor) or Held()
        signals, failed = self._derived.at(self.present, self.counters.steps, held.values, held.failed)
        self._silence = signals
        return frozenset(
            i
            for i in stream.blames
            if self.properties[i].silent(self.plan.silent[i], self.present, signals, failed) in NEGATIVE
        )

    def _excused(self, blameless: frozenset[int], stream: StreamPlan, signals: Mapping[str, Scalar]) -> frozenset[int]:
        """Of the guards that would be negative without the event too, those that do not blame it all the same.

        Where events that were denied, and have happened for all that, are the reason, one more of their kind would
        be let pass: it is to blame unless it adds nothing, since it is to the property as if no event had come.
        """
        return frozenset(i for i in blameless if not (self._may_be_their_doing(i) and self._adds(i, stream, signals)))

    def _may_be_their_doing(self, index: int) -> bool:
        state = self.properties[index]
        return state.stained or state.is_lost_beneath

    def _adds(self, index: int, stream: StreamPlan, signals: Mapping[str, Scalar]) -> bool:
        if self._traces_of(stream)[index] is Trace.SIGNALS:
            return True
        return stream.views[index].matches(signals) != self.plan.silent[index].matches(self._silence)

    def _stain(self, stream: StreamPlan) -> None:
        """Note that an event of a stream was denied, and has happened for all that."""
        for index, left in self._traces_of(stream).items():
            if left is not Trace.NONE:
                self.properties[index].stain()

    def _traces_of(self, stream: StreamPlan) -> dict[int, Trace]:
        found = self._traces.get(stream.spec.key)
        if found is None:
            spec = self.plan.spec
            found = {i: trace(spec, spec.properties[i], stream.spec) for i in stream.blames}
            self._traces[stream.spec.key] = found
        return found

    def _decide(self, step: Step, outcomes: Sequence[Outcome], blameless: frozenset[int] = NO_ONE) -> Decision | None:
        """The decision on an event, by the outcomes of all properties; None where none is wanted."""
        if not (step.event.ask and self._decides):
            return None
        guards = self.plan.streams[step.event.stream].guards
        states = self.properties
        denying = [
            i
            for i in guards
            if denies(outcomes[i], blamed=not (i in blameless or states[i].is_innocent), breaks=states[i].breaks)
        ]
        denied_by = tuple(states[i].property.id for i in denying)
        return Decision("deny" if denied_by else "allow", denied_by)
