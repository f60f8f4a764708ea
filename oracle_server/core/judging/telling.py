"""The part of a judge that makes verdicts of outcomes, explains them by the last steps, and follows episodes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial

from oracle_server.core.beyond import Beyond
from oracle_server.core.derived.state import Derived
from oracle_server.core.episode import Changes, Following
from oracle_server.core.events import Order, Signals, Source, Step
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.judging.counting import Counters
from oracle_server.core.judging.deciding import is_denied
from oracle_server.core.judging.following import follow
from oracle_server.core.judging.property_state import Names, PropertyState
from oracle_server.core.judging.recent import EFFORT_TOGETHER, Recent
from oracle_server.core.kinds import TICK
from oracle_server.core.owing import about
from oracle_server.core.past import Past
from oracle_server.core.plan import Plan
from oracle_server.core.records import EventRecord
from oracle_server.core.tally import StreamCounts
from oracle_server.core.verdicts import NEGATIVE, Decision, Explanation, Judged, Outcome, Verdict

Values = tuple[Beyond, ...]
NOTHING: Values = ()


class Telling:
    """Verdicts, what is remembered of the last steps, and what explanations make of it."""

    plan: Plan
    properties: Sequence[PropertyState]
    _numbers: Iterator[int]
    _degraded: bool
    _derived: Derived
    _recent: Recent
    _tick: tuple[int, Mapping[str, Scalar], Names] | None
    """The tick that is being judged."""
    _explained: int
    """What explanations have cost at the present step or tick."""
    _order: Order
    _decides: bool
    _knows_first: bool
    """Whether it judges an event before all other orders do."""
    counters: Counters
    counts: defaultdict[Source, StreamCounts]
    """What of that is counted by stream: what came late, and what was lost."""
    present: int
    following: Following
    """The episodes that may go on."""

    def remember(self, steps: int, effort: int) -> None:
        """Before the first step: remember this many steps, and spend this much on an explanation."""
        self._recent = Recent(steps, effort)

    def degrade(self) -> None:
        """Mark every verdict from now on as one before which something is known to be lost, skipped or failed."""
        self._degraded = True

    def bypass(self, properties: Collection[int]) -> None:
        """Mark the verdicts of these properties, by their indexes, as degraded until this is called again."""
        for i, state in enumerate(self.properties):
            state.bypassed = i in properties

    def recall(self, degraded: bool, bypassed: Collection[int]) -> None:
        """Bring back what a recorded row, which is judged again next, tells of losses before it, and of `bypass`."""
        self._degraded = degraded
        self.bypass(bypassed)

    def _count(self, step: Step) -> None:
        event, counters = step.event, self.counters
        whole = not event.row  # of an event with rows the first one counts
        counters.late += step.late and whole
        counters.skewed += step.skewed and whole
        counters.lost += event.lost
        if step.late or event.lost:
            counts = self.counts[event.monitor, event.stream]
            counts.late += step.late and whole and self._decides
            counts.lost += event.lost if self._knows_first else 0
        if event.lost or step.forced:
            self._degraded = True

    def _event(self) -> EventRecord:
        return self._recent.last()

    def _verdict(
        self, state: PropertyState, outcome: Outcome, signals: Mapping[str, Scalar], failed: Names, time: int
    ) -> Verdict:
        n, why, found = next(self._numbers), None, NOTHING
        if state.remember(n, outcome) or state.asked:
            state.note_first(n, None, time)
            why = self._explain(state, signals, failed, time, judged=False)
            found = values_beyond(state, signals) if outcome in NEGATIVE else NOTHING
        return self._plain(state, n, outcome, why, found)

    def _plain(
        self, state: PropertyState, n: int, outcome: Outcome, why: Explanation | None = None, found: Values = NOTHING
    ) -> Verdict:
        is_degraded = self._degraded or state.failures > 0 or state.renewed
        bypassed = state.bypassed and not is_degraded
        return Verdict(
            n, state.property.id, outcome, is_degraded or bypassed, why, None, bypassed, state.pending, found
        )

    def _explain(
        self, state: PropertyState, signals: Mapping[str, Scalar], failed: Names, time: int, *, judged: bool = True
    ) -> Explanation:
        """Why the last outcome is as it is; of what waits for what comes no signal is `judged` at a tick."""
        told, count = tuple(about(state.unanswered.told)), state.unanswered.count
        if state.why is None:
            return Explanation(state.property.text, signals, about=told, about_count=count)
        timed = state.property.time == "seconds"
        said = [state.why.text]
        if judged or state.owed is None:
            said += self._derived.told(state.property.atoms, signals, failed, time, self._recent.named)
        why = state.why.data(partial(self._recent.recall, timed=timed))
        text = "; ".join(said)
        if state.property.says != "formula":  # a sentence is told in its own words first
            text = f'"{state.property.text}": {text}'
        return Explanation(state.property.text, signals, text, why, told, count)

    def _conclude(
        self,
        step: Step,
        number: int | None,
        verdicts: tuple[Verdict, ...],
        now: int,
        decision: Decision | None = None,
    ) -> Judged:
        self.counters.denied += is_denied(decision)
        time = step.stamp if step.event.stream.kind == TICK else self.present
        return Judged(
            step, number, self._order, now, verdicts, decision, episodes=self._follow(time, verdicts, instant=False)
        )

    def _follow(self, time: int, verdicts: Sequence[Verdict], *, instant: bool) -> Changes:
        """What a row at a time (ns) does with episodes; `instant`: it is an attempt that was taken back."""
        self.following, changes = follow(self.following, self.plan.spec.gap, time, verdicts, instant=instant)
        return changes

    def _past(self, index: int) -> Past | None:
        """The last steps as one property observed them, and a tick that is being judged.

        None where the others' explanations have cost enough, unless this one was asked for.
        """
        if self._explained >= EFFORT_TOGETHER and not self.properties[index].asked:
            return None
        views = self.plan.streams
        tick = None if self._tick is None else (self._tick[0], self.plan.silent[index], *self._tick[1:])
        unread = self.plan.unread
        return self._recent.past(lambda stream: views[stream].views[index], tick, self._note_effort, unread.__getitem__)

    def _note_effort(self, effort: int) -> None:
        self._explained += effort


def values_beyond(state: PropertyState, signals: Signals) -> Values:
    """The values of the present step by which a property is negative, as it is known to be."""
    return NOTHING if state.look is None else state.look(signals) or NOTHING
