"""Judges steps in one order: signals to atoms, atoms to engines, outcomes to verdicts and a decision."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from oracle_server.core.engine import Engine
from oracle_server.core.events import Order, Step
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.plan import Plan, StreamPlan, View
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import (
    DENYING,
    FINAL,
    NEGATIVE,
    Decision,
    Explanation,
    Judged,
    Outcome,
    Verdict,
)

Names = frozenset[str] | set[str]


@dataclass(slots=True)
class PropertyState:
    """How one property stands in one session and order; `failures` counts the steps that could not be judged."""

    property: Property
    engine: Engine
    outcome: Outcome = Outcome.UNKNOWN
    negative: bool = False
    first_violation: int | None = None
    violations: int = 0
    failures: int = 0
    broken: str | None = None
    """Why the engine judges no more."""

    def step(self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names) -> Outcome:
        """The outcome at the next step."""
        if self.outcome in FINAL:
            return self.outcome
        outcome = self._ask_engine(view, time, signals)
        if outcome is Outcome.UNKNOWN or not view.reads.isdisjoint(failed):
            self.failures += 1
            return Outcome.UNKNOWN
        if self.property.latch and outcome in NEGATIVE:
            return Outcome.FALSE
        return outcome

    def _ask_engine(self, view: View, time: int, signals: Mapping[str, Scalar]) -> Outcome:
        if self.broken is not None:
            return Outcome.UNKNOWN
        matches: list[tuple[str, ...] | None] = [None] * view.size
        for test in view.tests:
            matches[test.index] = test.match(signals)
        try:
            return self.engine.step(time, matches)
        except Exception as error:  # noqa: BLE001 -- one engine's failure must not end a session
            self.broken = str(error) or type(error).__name__
            return Outcome.UNKNOWN

    def remember(self, verdict: int, outcome: Outcome) -> bool:
        """Take in the outcome of verdict number `verdict`; true where the property became negative with it."""
        self.outcome = outcome
        if outcome is Outcome.UNKNOWN:
            return False
        was, self.negative = self.negative, outcome in NEGATIVE
        if was or not self.negative:
            return False
        self.violations += 1
        self.first_violation = self.first_violation or verdict
        return True


@dataclass(slots=True)
class Counters:
    """What a judge has seen; `steps` are judged events, `skipped` those that were not."""

    steps: int = 0
    late: int = 0
    skewed: int = 0
    skipped: int = 0
    lost: int = 0
    denied: int = 0


class Judge:
    """The state of one session in one order of events."""

    def __init__(
        self,
        plan: Plan,
        engines: Sequence[Engine],
        order: Order,
        numbers: Iterator[int],
        *,
        decides: bool = True,
    ) -> None:
        """Judge with one fresh engine a property; verdicts are numbered from `numbers`."""
        self._plan = plan
        self._order = order
        self._numbers = numbers
        self._decides = decides
        self._held: dict[str, _Held] = {}
        self._degraded = False
        self._unordered = not any(stream.ordered for stream in plan.spec.streams)
        self.properties = [PropertyState(p, e) for p, e in zip(plan.spec.properties, engines, strict=True)]
        self.counters = Counters()
        self.present = 0
        """The time of the last step, in nanoseconds."""

    def degrade(self) -> None:
        """Mark every verdict from now on as one before which something is known to be lost, skipped or failed."""
        self._degraded = True

    def judge(self, step: Step, now: int) -> Judged:
        """Judge one step, or skip it; `now` becomes its time of judgement."""
        self.counters.late += step.late
        self.counters.skewed += step.skewed
        self.counters.lost += step.event.lost
        if step.event.lost or step.forced:
            self._degraded = True
        if step.skipped:
            return self._skip(step, now)
        return self._judge(step, now)

    def _skip(self, step: Step, now: int) -> Judged:
        self.counters.skipped += 1
        verdicts = tuple(
            Verdict(next(self._numbers), state.property.id, Outcome.UNKNOWN, self._is_degraded(state))
            for state in self.properties
        )
        self._degraded = True
        return self._conclude(step, None, verdicts, now)

    def _judge(self, step: Step, now: int) -> Judged:
        stream = self._plan.streams[step.event.stream]
        self.counters.steps += 1
        self._move_on(step, stream)
        signals, failed = self._signals(step, stream)
        verdicts = []
        for state, view in zip(self.properties, stream.views, strict=True):
            n, degraded = next(self._numbers), self._is_degraded(state)
            outcome = state.step(view, self.present, signals, failed)
            became_negative = state.remember(n, outcome)
            why = Explanation(state.property.text, signals) if became_negative else None
            verdicts.append(Verdict(n, state.property.id, outcome, degraded, why))
        return self._conclude(step, self.counters.steps, tuple(verdicts), now)

    def _move_on(self, step: Step, stream: StreamPlan) -> None:
        """Time never goes back, and an unordered event is judged at the present.

        Where there is none yet, or nothing but such events moves it, that is the earlier of its stamp and its arrival:
        a stamp from the future would be everyone's.
        """
        if self._order == "arrival":
            self.present = max(self.present, step.event.arrived)
        elif stream.spec.ordered:
            self.present = max(self.present, step.time)
        elif self._unordered or not self.present:
            self.present = max(self.present, min(step.time, step.event.arrived))

    def _is_degraded(self, state: PropertyState) -> bool:
        return self._degraded or state.failures > 0

    def _conclude(self, step: Step, number: int | None, verdicts: tuple[Verdict, ...], now: int) -> Judged:
        decision = None
        if step.event.ask and self._decides:
            guards = self._plan.streams[step.event.stream].guards
            denied_by = tuple(verdicts[i].property for i in guards if verdicts[i].outcome in DENYING)
            decision = Decision("deny" if denied_by else "allow", denied_by)
            self.counters.denied += bool(denied_by)
        return Judged(step, number, self._order, now, verdicts, decision)

    def _signals(self, step: Step, stream: StreamPlan) -> tuple[dict[str, Scalar], Names]:
        """All signals of a step: its own, the reserved ones, and what its monitor's streams hold."""
        event = step.event
        signals: dict[str, Scalar] = {**step.signals, **stream.constants, "monitor": event.monitor}
        if event.call is not None:
            signals["call"] = event.call
        if stream.spec.hold:
            self._held.setdefault(event.monitor, _Held()).take(stream.spec.hold, step)
        held = self._held.get(event.monitor)
        if held is None:
            return signals, step.failed
        return {**held.values, **signals}, step.failed | (held.failed - signals.keys())


@dataclass(slots=True)
class _Held:
    """The last values of one monitor's held signals; `failed` are those whose last value is not known."""

    values: dict[str, Scalar] = field(default_factory=dict)
    failed: set[str] = field(default_factory=set)

    def take(self, names: frozenset[str], step: Step) -> None:
        self.failed = (self.failed - names) | (names & step.failed)
        for name in names:
            self.values.pop(name, None)
            if name in step.signals:
                self.values[name] = step.signals[name]
