"""How one property stands in one session and order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

from oracle_server.core.beyond import Look, looking
from oracle_server.core.engine import (
    MAX_WORK,
    Answer,
    Bounded,
    Broken,
    Engine,
    Measuring,
    Receiving,
    Revisable,
    Savable,
    provides,
)
from oracle_server.core.errors import EngineError
from oracle_server.core.explanation import Why
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.judging.asked import Watch, watch
from oracle_server.core.judging.counted import Counted
from oracle_server.core.judging.deciding import Mark
from oracle_server.core.lost import lost
from oracle_server.core.owing import NO_UNANSWERED, AllUnanswered, Guarding, Owed, Owing
from oracle_server.core.past import Past
from oracle_server.core.plan import View
from oracle_server.core.records import EventRecord
from oracle_server.core.snapshot import PropertySnapshot
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import FINAL, NEGATIVE, Outcome

Names = frozenset[str] | set[str]
_HOLDS = Outcome.CURRENTLY_TRUE
_IDLE = f"its deadlines cost too much: {MAX_WORK} values may be looked at for those of all properties between two steps"

builtin_property = property
"""`property`, which is a field here."""


@dataclass(slots=True)
class PropertyState(Counted):
    """The property's engine and its last outcome; `failures` counts the steps that could not be judged."""

    property: Property
    engine: Engine
    outcome: Outcome = Outcome.UNKNOWN
    negative: bool = False
    first_violation: int | None = None
    first_violation_step: int | None = None
    """The number of its step, None for a deadline, and where only an older version had counted it."""
    first_violation_at: int | None = None
    """The stamp of its step in nanoseconds, None where it is not known."""
    violations: int = 0
    failures: int = 0
    broken: str | None = None
    """Why the engine does not judge any more."""
    why: Why | None = None
    """Why it became negative, where the engine can explain it; where `asked`, why the last outcome is as it is."""
    past: Callable[[], Past | None] | None = None
    """Returns what is remembered of the last steps, up to the present one; None where nothing more is explained."""
    asked: bool = False
    work: int = 0
    """What its last step or tick cost."""
    idle_work: int = 0
    """The cost of the ticks since the last step, which the engine forgets with them."""
    grace: int = 0
    """How long (ns) from the session's begin on it is unknown where it would be negative."""
    judged_from: int = 0
    """When (ns) its grace ends; 0 where it has none, or no session has begun."""
    bypassed: bool = False
    """Whether a stream that it guards or reads is bypassed at present."""
    renewed: bool = False
    """Whether its external oracle may have lost its state."""
    lacking: Callable[[], str | None] | None = None
    """Returns why derived signals that it reads have failed for want of room, where it reads any."""
    unexplained: int = 0
    """How often an explanation failed; engines that never explain are not counted."""
    _inexplicable: str = ""
    unanswered: AllUnanswered = NO_UNANSWERED
    """The obligations that were decided false at the last step, or by the time that came last."""
    owed: Owed | None = field(init=False, default=None)
    """Its obligations, None where its formula only looks back, or it is not judged any more."""
    settles: bool = False
    """Whether time has decided some, when it came last."""
    watch: Watch | None = field(init=False)
    """What it waits for as long as nothing was asked of it."""
    stained: bool = False
    """Whether an event that was denied may still count, since it has happened for all that; see `blame: caused`."""
    unowed: Outcome = _HOLDS
    """What the last step comes to without the obligations that were decided at it."""
    is_innocent: bool = False
    """Whether the last step holds by itself, where the property is latched."""
    look: Look | None = field(init=False)
    """What finds the values beyond its bounds where it is negative; None where it has none, or a robustness."""
    lasts: bool = field(init=False, default=True)
    _failure: Exception | None = field(init=False, default=None)
    """What its next tick fails by."""
    _goes_on: bool = field(init=False)
    """Whether the engine is asked on once the property is latched, to tell whom it blames."""
    _guarding: Guarding | None = field(init=False)
    """The engine, where it tells what breaks obligations that were decided before, and has not failed."""
    _revisable: Revisable | None = field(init=False)
    """The engine, where it can take steps back and has not failed."""
    _measuring: Measuring | None = field(init=False)
    """The engine, where it measures and has not failed."""

    def __post_init__(self) -> None:
        """Find out once what its engine can do."""
        self.owed = self.engine.owed if provides(self.engine, Owing) else None
        self._revisable = self.engine if provides(self.engine, Revisable) else None
        self._measuring = self.engine if provides(self.engine, Measuring) else None
        self._guarding = self.engine if self.owed is not None and provides(self.engine, Guarding) else None
        prop, lasts = self.property, self.property.latch or self.owed is not None  # it may hold at a step all the same
        self.watch = watch(prop)
        self.look = looking(prop.formula, fails=not lasts) if self._measuring is None else None
        self._goes_on = prop.latch and prop.blame == "caused" and bool(prop.guards) and self._revisable is not None

    def step(
        self,
        view: View,
        time: int,
        signals: Mapping[str, Scalar],
        failed: Names,
        latest: int = 0,
        allowed: int = MAX_WORK,
    ) -> Outcome:
        """The outcome at the next step, which may cost what is `allowed`; `latest` (ns) is past, whatever its stamp."""
        self.work = self.idle_work = 0
        self.unanswered, self.is_innocent = NO_UNANSWERED, False
        if self.outcome in FINAL:
            if self._goes_on:
                self._ask_beneath(view, time, signals, failed, allowed)
            return self.outcome
        outcome = self._ask_engine(view, time, signals, failed, allowed)
        if outcome is self.outcome and outcome is _HOLDS and self.owed is None and not failed:
            return outcome  # as nearly always
        return self._outcome_at(view, max(time, latest), failed, outcome)

    def _ask_beneath(self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names, allowed: int) -> None:
        """Take a step where the property is latched: what its formula comes to tells whom it blames."""
        outcome = self._ask_engine(view, time, signals, failed, allowed)
        known = outcome is not Outcome.UNKNOWN and view.reads.isdisjoint(failed)
        self.is_innocent = known and not (outcome in NEGATIVE or self.breaks)

    @builtin_property
    def is_lost_beneath(self) -> bool:
        """Whether it is latched, and its engine can't tell any more what its formula comes to."""
        return self.property.latch and self.outcome is Outcome.FALSE and not self._goes_on

    def stain(self) -> None:
        """Note that an event which was denied may count at later steps, since it has happened for all that."""
        self.stained = True

    def _outcome_at(self, view: View, latest: int, failed: Names, outcome: Outcome) -> Outcome:
        """What an outcome of the engine comes to at a step, by when a time (ns) must have come."""
        self.take_unanswered(tick=False)
        self.unowed = _HOLDS
        fails = bool(failed) and not view.reads.isdisjoint(failed)
        if outcome is Outcome.UNKNOWN or fails:
            # before a formula over numbers begins nothing is missed
            if fails or self._measuring is None or self._measuring.begun:
                self.failures += view.observed
            self.unowed = Outcome.UNKNOWN
            if not self.unanswered:
                return Outcome.UNKNOWN
        if outcome in NEGATIVE and latest < self.judged_from:
            return Outcome.UNKNOWN
        if self.property.latch and outcome in NEGATIVE:
            return Outcome.FALSE
        return outcome

    def receive(self, answer: Answer) -> None:
        """Use the answer of an external oracle for the next step."""
        self.renewed = self.renewed or answer.anew
        if provides(self.engine, Receiving):
            self.engine.receive(answer)

    def next_deadline(self, after: int) -> int | None:
        """When, after `after` (ns), time alone may change the outcome; None for never."""
        if self.property.time != "seconds" or self.outcome in FINAL:
            return None
        engine = self._revisable
        deadline = engine.next_deadline(after) if engine is not None else None
        if self.judged_from <= after:
            return deadline
        return self.judged_from if deadline is None else min(deadline, self.judged_from)

    @builtin_property
    def pending(self) -> int | None:
        """How many obligations are open, None where it can have none."""
        return None if self.owed is None else 0 if self.outcome in FINAL else self.owed.pending

    @builtin_property
    def breaks(self) -> bool:
        """Whether the last step broke what is asked by `always`, though that may have been decided before."""
        return self._guarding is not None and self._guarding.breaks

    def hear(self, event: Callable[[], EventRecord]) -> None:
        """Have its obligations told the event of the present step by this."""
        if self.owed is not None:
            self.owed.event = event

    def end(self) -> Outcome:
        """The outcome once nothing will come any more; that of before where this decides nothing."""
        self.settles = False
        if self.property.at_end != "violated" or self.outcome in FINAL or not provides(self.engine, Owing):
            return self.outcome
        return self._pass(self.engine.end)

    def begin(self, time: int) -> None:
        """Begin its grace at a time (ns), that of its session's begin."""
        self.judged_from = time + self.grace if self.grace else 0

    def tick(
        self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names, allowed: int = MAX_WORK
    ) -> Outcome:
        """The outcome at a step that is then taken back, and may cost what is `allowed`; final only where latched."""
        self.work, self.settles = 0, False
        engine = self._revisable
        if engine is None or self.property.time != "seconds" or self.outcome in FINAL:
            return self.outcome
        if self.owed is not None and provides(engine, Owing):
            return self._pass(partial(engine.pass_time, time))
        engine.mark()
        outcome = self._ask_engine(view, time, signals, failed, allowed)
        if outcome in NEGATIVE and time < self.judged_from:
            outcome = Outcome.UNKNOWN
        if self.broken is not None and allowed < MAX_WORK:
            self.broken = _IDLE
        self._explain(outcome)
        self._take_back(engine)
        if self.broken is not None:
            self.failures += 1
            return Outcome.UNKNOWN
        if outcome is Outcome.UNKNOWN or not view.reads.isdisjoint(failed):
            return Outcome.UNKNOWN
        return Outcome.FALSE if self.property.latch and outcome in NEGATIVE else outcome.current

    def decide(self, time: int, enough: Callable[[], bool]) -> bool:
        """Before a tick at which it is due: let time decide a part of what it will then; whether nothing is left."""
        if self.owed is None or not provides(self.engine, Owing):
            return True
        try:
            return self.engine.decide(time, enough)
        except Exception as error:  # noqa: BLE001 -- as with the tick, which tells of it
            self._failure = error
            return True

    def silent(self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names) -> Outcome:
        """The outcome at a step without signals but held ones, in the place of the next one."""
        engine = self._revisable
        if self.outcome in FINAL and not self._goes_on:
            return self.outcome
        if engine is None:
            return Outcome.UNKNOWN if self.broken is not None else self.outcome
        engine.mark()
        outcome = self._ask_engine(view, time, signals, failed)
        if self.breaks and outcome is not Outcome.UNKNOWN:
            outcome = Outcome.CURRENTLY_FALSE
        self._take_back(engine)
        return outcome if view.reads.isdisjoint(failed) else Outcome.UNKNOWN

    def mark(self) -> Mark:
        """Remember how the property stands, and begin a step that may be taken back."""
        engine = self._revisable
        if engine is not None:
            engine.mark()
        first = self.first_violation, self.first_violation_step, self.first_violation_at
        return Mark(self.outcome, self.negative, self.failures, self.violations, first)

    def back(self, mark: Mark, *, counts: bool = True) -> None:
        """Take the step back; a violation stays counted, and an engine that failed at it stays failed.

        Not so of obligations where the property did not deny the step, so that it `counts`: they will be decided yet.
        """
        engine, failures = self._revisable, self.failures
        if engine is not None:
            engine.back()
        self.outcome, self.negative, self.failures, violations, first = mark
        if self.owed is not None and not counts:
            self.violations = violations
            self.first_violation, self.first_violation_step, self.first_violation_at = first
        if self.broken is not None:
            self.outcome, self.failures = Outcome.UNKNOWN, failures

    def keep(self) -> None:
        """Keep the step."""
        engine = self._revisable
        if engine is not None:
            engine.keep()

    def snapshot(self) -> PropertySnapshot | None:
        """All that later verdicts depend on, as plain data; None where the engine can't be saved."""
        engine = None
        if self.broken is None and (self.outcome not in FINAL or self._goes_on):
            if not provides(self.engine, Savable):
                return None
            engine = self.engine.snapshot()
        return {
            "outcome": self.outcome.value,
            "negative": self.negative,
            "first_violation": self.first_violation,
            "first_violation_step": self.first_violation_step,
            "first_violation_at": self.first_violation_at,
            "violations": self.violations,
            "failures": self.failures,
            "broken": self.broken,
            "renewed": self.renewed,
            "stained": self.stained,
            "watch": self.watch.snapshot() if self.watch else None,
            "engine": engine,
        }

    def restore(self, data: PropertySnapshot) -> None:
        """Take over a snapshot. Raises `EngineError` where the engine can't use it."""
        self.outcome, self.negative = Outcome(data["outcome"]), data["negative"]
        self.first_violation, self.violations = data["first_violation"], data["violations"]
        self.first_violation_step = data.get("first_violation_step")
        self.first_violation_at = data.get("first_violation_at")
        self.failures, self.broken = data["failures"], data["broken"]
        if self.broken is not None:
            self._revisable = self._measuring = None
        self.renewed = data.get("renewed", False)
        self.stained = data.get("stained", True)
        self.watch = self.watch.restored(data.get("watch")) if self.watch else None
        self._goes_on = self._goes_on and (data["engine"] is not None or self.outcome not in FINAL)
        if data["engine"] is not None:
            if not provides(self.engine, Savable):
                raise EngineError("a snapshot of another engine")
            self.engine.restore(data["engine"])

    @builtin_property
    def robustness(self) -> float | None:
        """The engine's robustness at the last step; None where it was not stepped, or has none."""
        return None if self.outcome in FINAL or self._measuring is None else self._measuring.robustness

    def _take_back(self, engine: Revisable) -> None:
        """Take a tick back, and count its cost."""
        if self.broken is not None:
            return
        self.idle_work += self.work
        engine.back()
        if self.idle_work > MAX_WORK:
            self.give_up(_IDLE)

    def give_up(self, reason: str) -> None:
        """Stop judging, for this reason."""
        self.broken, self._revisable, self._measuring = reason, None, None
        self.engine, self.owed, self._guarding = Broken(self.complaint), None, None

    def _pass(self, passes: Callable[[], None]) -> Outcome:
        """The outcome once time has decided what it does, for good."""
        try:
            if self._failure is not None:
                raise self._failure  # noqa: TRY301 -- it is as if that came now
            passes()
        except Exception as error:  # noqa: BLE001 -- one engine's failure must not end a session
            self.give_up(str(error) or type(error).__name__)
            self.failures += 1
            return Outcome.UNKNOWN
        self.take_unanswered(tick=True)
        self.settles = self.owed is not None and self.owed.closed > 0
        outcome = self.outcome
        if self.settles:
            outcome = Outcome.CURRENTLY_FALSE if self.unanswered else Outcome.CURRENTLY_TRUE
        if self.settles or self.asked:
            self._explain(outcome)
        return Outcome.FALSE if self.property.latch and self.unanswered else outcome

    def _ask_engine(
        self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names, allowed: int = MAX_WORK
    ) -> Outcome:
        if self.broken is not None:
            return Outcome.UNKNOWN
        engine = self.engine
        try:
            if failed and self.owed and provides(engine, Owing) and not view.reads.isdisjoint(failed):
                engine.lose(lost(view, signals, failed))
            found = view.matches(signals)
            if self.watch is not None and view.tests:
                self.watch = self.watch.see(found)
            if allowed < MAX_WORK and provides(engine, Bounded):
                engine.allow(allowed)
                outcome = engine.step(time, found)
                engine.allow(MAX_WORK)
            else:
                outcome = engine.step(time, found)
        except Exception as error:  # noqa: BLE001 -- one engine's failure must not end a session
            self.give_up(str(error) or type(error).__name__)
            outcome = Outcome.UNKNOWN
        self.work = getattr(engine, "work", 0)
        return outcome
