"""Judges steps in one order: signals to atoms, atoms to engines, outcomes to verdicts and a decision."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import msgspec

from oracle_server.core.derived.state import Derived, LastStep
from oracle_server.core.engine import MAX_WORK, MAX_WORK_TOGETHER, Engine, Measuring, provides
from oracle_server.core.episode import Following, loaded, saved
from oracle_server.core.events import ENDED, TICKS, Event, Order, Signals, Source, Step
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.judging.blaming import NO_ONE, Blaming
from oracle_server.core.judging.counting import Counters, Told
from oracle_server.core.judging.deciding import Before, attempted, is_denied
from oracle_server.core.judging.holding import Held, Holding
from oracle_server.core.judging.presence import grace
from oracle_server.core.judging.property_state import Names, PropertyState
from oracle_server.core.judging.recent import Recent
from oracle_server.core.judging.telling import values_beyond
from oracle_server.core.owing import NO_UNANSWERED
from oracle_server.core.plan import Plan, StreamPlan
from oracle_server.core.snapshot import JudgeSnapshot
from oracle_server.core.spec import Property, orders
from oracle_server.core.tally import StreamCounts
from oracle_server.core.verdicts import FINAL, NEGATIVE, Judged, Outcome, Verdict
from oracle_server.core.weakly import weakly

Seen = tuple[Signals, frozenset[str]]
"""Signals, and those that failed."""


class Judge(Blaming):
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
        super().__init__()
        self.plan = plan
        self._order = order
        self._numbers = numbers
        self._decides, self._knows_first = decides, order == orders(plan.spec)[-1]
        self._measures = any(provides(engine, Measuring) for engine in engines)
        self._held = Holding()
        self._derived = Derived(plan.derived)
        self._degraded = False
        ordering = plan.spec.ordering
        self._slack = ordering.max_skew + (ordering.max_delay or 0)
        """How much later than its stamp an event arrives (ns), where clocks are in step."""
        self._unordered = not any(stream.ordered for stream in plan.spec.streams)
        self.properties = [
            self._state(p, e, grace(p.formula, p.time)) for p, e in zip(plan.spec.properties, engines, strict=True)
        ]
        self.counters = Counters()
        self.counts: defaultdict[Source, StreamCounts] = defaultdict(StreamCounts)
        """What of that is counted by stream: what came late, and what was lost."""
        self._allowed = MAX_WORK_TOGETHER // (2 if ordering.by == "both" else 1)
        """What a step may cost all properties; one that is judged in two orders has two halves."""
        self._explained = 0
        """What explanations have cost at the present step or tick."""
        self._idle_work = 0
        """What the ticks since the last step have cost all properties."""
        self.following = Following()
        self.present = 0
        """The time of the last step, in nanoseconds."""
        self._ticked = 0
        self.is_deciding = False
        """Whether a part of what time decides at once is decided, and the rest is not yet."""
        self._outdated = False
        """Whether a step is older than deadlines that were judged already: they are to be judged again."""
        self._recent = Recent()
        self._tick: tuple[int, Mapping[str, Scalar], Names] | None = None
        for i, state in enumerate(self.properties):
            state.past = partial(weakly(self._past), i)
            state.hear(weakly(self._event))
            state.lacking = partial(self._derived.complaint, state.property.atoms)

    def _state(self, prop: Property, engine: Engine, grace: int) -> PropertyState:
        return PropertyState(prop, engine, grace=grace)

    @property
    def told(self) -> Told:
        """How its properties stand, and what it has counted."""
        return Told(self.properties, self.counters, self.following, self._degraded)

    @property
    def is_ticking(self) -> bool:
        """Whether some of the deadlines at one time are judged, and others are not yet."""
        return self._derived.is_due(self.present, self.counters.steps)

    @property
    def next_deadline(self) -> int | None:
        """When time alone may change an outcome next, in nanoseconds; None for never."""
        if not self.plan.timed:
            return None
        if self._outdated or self.is_ticking:
            return self._ticked
        after = max(self.present, self._ticked)
        deadlines = [d for state in self.properties if (d := state.next_deadline(after)) is not None]
        turn = self._derived.next_deadline(after, self._last)
        return min(deadlines if turn is None else [*deadlines, turn], default=None)

    def snapshot(self) -> JudgeSnapshot | None:
        """All that later verdicts depend on, as plain data; None where an engine can't be saved."""
        states = [found for state in self.properties if (found := state.snapshot()) is not None]
        if len(states) < len(self.properties):
            return None
        return {
            "properties": states,
            "held": [(monitor, held.values, sorted(held.failed)) for monitor, held in self._held.all()],
            "counters": {name: getattr(self.counters, name) for name in Counters.__slots__},
            "degraded": self._degraded,
            "present": self.present,
            "ticked": self._ticked,
            "outdated": self._outdated,
            "recent": self._recent.snapshot(),
            "derived": self._derived.snapshot(),
            "episodes": saved(self.following),
        }

    def restore(self, data: JudgeSnapshot, numbers: Iterator[int]) -> None:
        """Take over a snapshot; verdicts are numbered from `numbers`. Raises `EngineError` where it can't be used."""
        for state, known in zip(self.properties, data["properties"], strict=True):
            state.restore(known)
        self._held = Holding((monitor, Held(dict(values), set(failed))) for monitor, values, failed in data["held"])
        self.counters = Counters(**data["counters"])
        self._degraded, self.present, self._ticked = data["degraded"], data["present"], data["ticked"]
        self._outdated = data.get("outdated", False)
        self._recent.restore(data["recent"])
        self._derived.restore(data.get("derived"))
        self.following = loaded(data.get("episodes"))
        self._numbers = numbers

    def give_up(self, reason: str, numbers: Iterator[int]) -> None:
        """Stop judging all properties, for this reason; verdicts are numbered from `numbers`."""
        for state in self.properties:
            state.give_up(reason)
        self._degraded, self._numbers = True, numbers

    def begin(self, time: int) -> None:
        """Begin at a time (ns): what never comes is missed from then on."""
        for state in self.properties:
            state.begin(time)
        self._derived.begin(time)

    def judge(self, step: Step, now: int) -> Judged:
        """Judge one step, or skip it; `now` becomes its time of judgement."""
        event = step.event
        if step.late or step.skewed or step.forced or event.lost:
            self._count(step)
        if step.skipped:
            return self._skip(step, now)
        if event.ask and self._decides and self.plan.streams[event.stream].undoes:
            return self._try(step, now)
        return self._judge(step, now)

    def decide(self, time: int, enough: Callable[[], bool]) -> bool:
        """Before a tick at its next deadline (ns): let time decide a part of what is open, until `enough`.

        Whether nothing is left; else nothing is judged, and no snapshot taken, before that is so and the tick.
        """
        owing = [state for state in self.properties if state.owed is not None and self._due(state, time)]
        self.is_deciding = not all(state.decide(time, enough) for state in owing)
        return not self.is_deciding

    def tick(self, time: int, now: int, recorded: Signals | None = None) -> Judged | None:
        """Judge a step at `time` without an event's own signals, and take it back; None where it changes no outcome.

        It is judged by the properties of which a deadline has run out since the last step: another one's deadline is no
        step of theirs. Before the first step only those with a grace are judged, and those that read derived signals:
        nothing else is known then. `recorded` are the signals of one that was judged before.
        """
        turn = self._derived.turn(time, self._last, self._runs_out, recorded)
        self._ticked, self._outdated = time, False
        if turn is None:
            return None
        held, failing = self._held.together()
        failing -= turn.carried.keys()
        stored: Mapping[str, Scalar] = {**held, **turn.carried}
        signals, failed = self._derived.at(time, self.counters.steps, stored, failing)
        turned = {*turn.turned, *self._derived.turned_for(signals, self._last)}
        views = self.plan.silent
        self._tick, self._explained = (time, signals, failed), 0
        found, settles, others = [], False, []
        for i, (state, view) in enumerate(zip(self.properties, views, strict=True)):
            state.unanswered = NO_UNANSWERED
            if i not in turned and not self._due(state, time):
                found.append(state.outcome)
                others.append(state)
                continue
            found.append(state.tick(view, time, signals, failed, MAX_WORK - self._idle_work))
            self._idle_work += state.work
            settles = settles or state.settles
        self._tick = None
        for state in others:
            state.explain(state.outcome)  # as at the last step, where it is asked for
        changed = any(state.outcome is not outcome for state, outcome in zip(self.properties, found, strict=True))
        if not changed and not settles:
            return None
        return self._ticked_with(found, (signals, frozenset(failed)), (stored, frozenset(failing)), time, now)

    def end(self, now: int, at: int | None = None) -> Judged | None:
        """Decide what is open, for properties with `at_end: violated`: nothing will come any more.

        `at` is the time (ns), where it is recorded. None where no obligation is decided by that.
        """
        for state in self.properties:
            state.unanswered = NO_UNANSWERED
        found = [state.end() for state in self.properties]
        if not any(state.settles for state in self.properties):
            return None
        for state in self.properties:
            if not state.settles:
                state.explain(state.outcome)
        time = self._until if at is None else at
        held, failing = self._held.together()
        signals, failed = self._derived.at(time, self.counters.steps, held, failing)
        return self._ticked_with(found, (signals, frozenset(failed)), (held, frozenset(failing)), time, now, ENDED)

    @property
    def _until(self) -> int:
        """Up to when (ns) it has judged."""
        return max(self.present, self._ticked)

    def _ticked_with(
        self, found: Sequence[Outcome], seen: Seen, stored: Seen, time: int, now: int, source: str = ""
    ) -> Judged:
        """A recorded tick with these outcomes; `stored` are the signals that it is judged again with."""
        self.counters.ticks += 1
        known = zip(self.properties, found, strict=True)
        verdicts = tuple([self._verdict(s, outcome, *seen, time) for s, outcome in known])
        event = Event(TICKS, "", self.counters.ticks, time, now, None, source)
        return self._conclude(Step(event, *stored, time), None, verdicts, now)

    def _runs_out(self, time: int) -> bool:
        """Whether some engine's deadline runs out up to a time, since the last step or tick."""
        after = max(self.present, self._ticked)
        deadlines = (state.next_deadline(after) for state in self.properties)
        return self._outdated or any(d is not None and d <= time for d in deadlines)

    @property
    def _last(self) -> LastStep:
        ticked = self.present if self._outdated else self._ticked
        return LastStep(self.present, self.counters.steps, ticked, self._held.together)

    def _due(self, state: PropertyState, time: int) -> bool:
        deadline = state.next_deadline(self.present) if self.counters.steps or state.grace else None
        return deadline is not None and deadline <= time

    def _try(self, step: Step, now: int) -> Judged:
        """Judge a step, and take it back where it is denied, as if it had never happened."""
        before = self._attempt()
        judged = self._judge(step, now, revisable=True)
        if is_denied(judged.decision):
            return self._take_back(judged, before)
        for state in self.properties:
            state.keep()
        self._derived.journal.keep()
        return judged

    def _attempt(self) -> Before:
        """Begin a step that may be taken back."""
        before = Before(
            [state.mark() for state in self.properties],
            self.present, self.counters.steps, self._held.version, self._ticked, self._outdated, self.following,
        )  # fmt: skip
        self._derived.journal.mark()
        return before

    def _take_back(self, judged: Judged, before: Before) -> Judged:
        """Take the last step back, as if it had never happened; what was judged of it is not final."""
        time = self.present
        marks, self.present, self.counters.steps, held, self._ticked, self._outdated, self.following = before
        self._held.go_to(held)
        denying = frozenset(judged.decision.denied_by if judged.decision else ())
        for state, mark in zip(self.properties, marks, strict=True):
            state.back(mark, counts=state.property.id in denying)
        self._derived.back()
        self._recent.remove()
        stood = zip(self.properties, marks, strict=True)
        open_ = [s for s, mark in stood if s.owed is not None and mark.outcome not in FINAL]
        owing = {s.property.id: s.unowed for s in open_ if s.property.id not in denying}
        verdicts = tuple(attempted(v, owing.get(v.property)) for v in judged.verdicts)
        return msgspec.structs.replace(judged, verdicts=verdicts, episodes=self._follow(time, verdicts, instant=True))

    def _skip(self, step: Step, now: int) -> Judged:
        self.counters.skipped += not step.event.row
        verdicts = tuple(self._plain(state, next(self._numbers), Outcome.UNKNOWN) for state in self.properties)
        self._degraded = True
        return self._conclude(step, None, verdicts, now, self._decide(step, [Outcome.UNKNOWN] * len(verdicts)))

    def _judge(self, step: Step, now: int, *, revisable: bool = False) -> Judged:
        """Judge a step; `revisable`: it is taken back where it is denied."""
        stream = self.plan.streams[step.event.stream]
        self.counters.steps += 1
        before = self.present
        self._move_on(step, stream)
        if self._ticked > self.present:
            self._outdate(before)
        blameless = self._blameless(step, stream) if stream.blames else NO_ONE
        signals, failed = self._signals(step, stream)
        if stream.derives or self.counters.steps == 1:
            failed = self._derived.step(stream.derives, step, signals, failed, self.present, self.counters.steps)
        self._recent.add(self.counters.steps, self.present, step, signals, failed)
        number: int | None = self.counters.steps
        outcomes, worse, time, degraded = [], [], self.present, self._degraded
        latest = self._surely_past(step)
        allowed, self._idle_work, self._explained = self._allowed, 0, 0
        for state, view in zip(self.properties, stream.views, strict=True):
            worse.append(degraded or state.failures > 0 or state.renewed)
            outcomes.append(state.step(view, time, signals, failed, latest, allowed))
            allowed -= state.work
        if blameless:
            blameless = self._excused(blameless, stream, signals)
        decision = self._decide(step, outcomes, blameless)
        if revisable and is_denied(decision):
            self._recent.unnumber()
            number = None
        elif stream.blames and is_denied(decision):
            self._stain(stream)
        verdicts = []
        for state, view, outcome, is_degraded in zip(self.properties, stream.views, outcomes, worse, strict=True):
            state.explain(outcome)
            robustness = state.robustness if self._measures else None
            n = next(self._numbers)
            why = None
            if state.remember(n, outcome) or state.asked:
                state.note_first(n, number, step.stamp)
                why = self._explain(state, signals, failed, self.present)
            passed_by = state.bypassed and not is_degraded
            degraded = is_degraded or passed_by
            found = values_beyond(state, signals) if outcome in NEGATIVE and view.observed else ()
            verdicts.append(Verdict(
                n, state.property.id, outcome, degraded, why, robustness, passed_by, state.pending, found
            ))  # fmt: skip
        return self._conclude(step, number, tuple(verdicts), now, decision)

    def _surely_past(self, step: Step) -> int:
        """A time (ns) that is past, whatever the step's stamp: a clock that is far behind must not prolong a grace."""
        return step.event.arrived - self._slack

    def _move_on(self, step: Step, stream: StreamPlan) -> None:
        """Time never goes back, and an unordered event is judged at the present.

        Where there is no present yet, or only unordered events move it, the present becomes the earlier of the event's
        stamp and arrival: otherwise one stamp from the future would apply to all later events.
        """
        if self._order == "arrival":
            self.present = max(self.present, step.event.arrived)
        elif stream.spec.ordered:
            self.present = max(self.present, step.time)
        elif self._unordered or not self.present:
            self.present = max(self.present, min(step.time, step.event.arrived))

    def _outdate(self, before: int) -> None:
        """Have deadlines judged again that were judged before this older step: the outcome is as of a time before them.

        Where the step moved the present, those after it; else only the last one, since the present may be long ago.
        """
        if self.present > before:
            self._ticked = self.present
        else:
            self._outdated = True

    def _signals(self, step: Step, stream: StreamPlan) -> tuple[dict[str, Scalar], Names]:
        """All signals of a step: its own, the reserved ones, and those that its monitor's streams hold."""
        event = step.event
        signals: dict[str, Scalar] = {**step.signals, **stream.constants, "monitor": event.monitor}
        if event.call is not None:
            signals["call"] = event.call
        if not stream.spec.hold and not self._held:
            return signals, step.failed
        if stream.spec.hold:
            self._held.take(event.monitor, stream.spec.hold, step)
        known = self._held.of(event.monitor)
        if known is None:
            return signals, step.failed
        kept = known.values
        if not step.failed.isdisjoint(kept):  # a signal of its own that failed is not what another stream holds
            kept = {name: value for name, value in kept.items() if name not in step.failed}
        return {**kept, **signals}, step.failed | (known.failed - signals.keys())
