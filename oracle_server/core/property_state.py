"""How one property stands in one session and order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from oracle_server.core.atoms import Matches
from oracle_server.core.engine import (
    MAX_WORK,
    Answer,
    Bounded,
    Engine,
    Explaining,
    Measuring,
    Receiving,
    Revisable,
    Savable,
)
from oracle_server.core.errors import EngineError
from oracle_server.core.explanation import Why
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.plan import View
from oracle_server.core.snapshot import PropertySnapshot
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import FINAL, NEGATIVE, Outcome

Names = frozenset[str] | set[str]
_IDLE = f"its deadlines cost too much: {MAX_WORK} values may be looked at for those of all properties between two steps"


builtin_property = property
"""`property`, which is a field here."""


class Mark(NamedTuple):
    """The part of a property's state that a step which is taken back must not change."""

    outcome: Outcome
    negative: bool
    failures: int


class _Broken:
    """Replaces an engine that failed, to free its memory; `complaint` is what that engine reported."""

    def __init__(self, complaint: str | None) -> None:
        self.complaint = complaint

    def step(self, time: int, matches: Matches) -> Outcome:  # noqa: ARG002
        """No judgement."""
        return Outcome.UNKNOWN


@dataclass(slots=True)
class PropertyState:
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
    unexplained: int = 0
    """How often an explanation failed; engines that never explain are not counted."""
    _inexplicable: str = ""
    _revisable: Revisable | None = field(init=False)
    """The engine, where it can take steps back and has not failed."""

    def __post_init__(self) -> None:
        self._revisable = self.engine if isinstance(self.engine, Revisable) else None

    def step(
        self,
        view: View,
        time: int,
        signals: Mapping[str, Scalar],
        failed: Names,
        latest: int = 0,
        allowed: int = MAX_WORK,
    ) -> Outcome:
        """The outcome at the next step, which may cost what is `allowed`.

        `latest` is the time (ns) that must have come by then, whatever its stamp.
        """
        self.work = self.idle_work = 0
        if self.outcome in FINAL:
            return self.outcome
        outcome = self._ask_engine(view, time, signals, allowed)
        if outcome is Outcome.UNKNOWN or (failed and not view.reads.isdisjoint(failed)):
            self.failures += view.observed
            return Outcome.UNKNOWN
        if outcome in NEGATIVE and max(time, latest) < self.judged_from:
            return Outcome.UNKNOWN
        if self.property.latch and outcome in NEGATIVE:
            return Outcome.FALSE
        return outcome

    def receive(self, answer: Answer) -> None:
        """Use the answer of an external oracle for the next step."""
        self.renewed = self.renewed or answer.anew
        if isinstance(self.engine, Receiving):
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

    def begin(self, time: int) -> None:
        """Begin its grace at a time (ns), that of its session's begin."""
        self.judged_from = time + self.grace if self.grace else 0

    def tick(
        self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names, allowed: int = MAX_WORK
    ) -> Outcome:
        """The outcome at a step that is then taken back, and may cost what is `allowed`; final only where latched."""
        self.work = 0
        engine = self._revisable
        if engine is None or self.property.time != "seconds" or self.outcome in FINAL:
            return self.outcome
        engine.mark()
        outcome = self._ask_engine(view, time, signals, allowed)
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

    def silent(self, view: View, time: int, signals: Mapping[str, Scalar], failed: Names) -> Outcome:
        """The outcome at a step without signals but held ones, in the place of the next one."""
        engine = self._revisable
        if engine is None or self.outcome in FINAL:
            return self.outcome
        engine.mark()
        outcome = self._ask_engine(view, time, signals)
        self._take_back(engine)
        return outcome if view.reads.isdisjoint(failed) else Outcome.UNKNOWN

    def mark(self) -> Mark:
        """Remember how the property stands, and begin a step that may be taken back."""
        engine = self._revisable
        if engine is not None:
            engine.mark()
        return Mark(self.outcome, self.negative, self.failures)

    def back(self, mark: Mark) -> None:
        """Take the step back; a violation stays counted, and an engine that failed at it stays failed."""
        engine, failures = self._revisable, self.failures
        if engine is not None:
            engine.back()
        self.outcome, self.negative, self.failures = mark
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
        if self.outcome not in FINAL and self.broken is None:
            if not isinstance(self.engine, Savable):
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
            self._revisable = None
        self.renewed = data.get("renewed", False)
        if data["engine"] is not None:
            if not isinstance(self.engine, Savable):
                raise EngineError("a snapshot of another engine")
            self.engine.restore(data["engine"])

    @builtin_property
    def robustness(self) -> float | None:
        """The engine's robustness at the last step; None where it was not stepped, or has none."""
        if self.outcome in FINAL or self.broken is not None or not isinstance(self.engine, Measuring):
            return None
        return self.engine.robustness

    @builtin_property
    def complaint(self) -> str | None:
        """What went wrong in the engine, None for nothing."""
        found = getattr(self.engine, "complaint", None)
        if self.unexplained:
            times = "once" if self.unexplained == 1 else f"{self.unexplained} times"
            found = f"{found}; " if found else ""
            found += f"it could not say why {times}; the last time: {self._inexplicable}"
        return found

    def explain(self, outcome: Outcome) -> None:
        """Before `remember`: find out why the last step has this outcome, where it is a violation or was asked for."""
        if self.outcome not in FINAL and outcome is not Outcome.UNKNOWN:
            self._explain(outcome)

    def _explain(self, outcome: Outcome) -> None:
        if self.asked or (outcome in NEGATIVE and not self.negative):
            past = NO_PAST if self.past is None else self.past()
            self.why = None
            if past is not None and isinstance(self.engine, Explaining):
                try:
                    self.why = self.engine.explain(past)
                except Exception as error:  # noqa: BLE001 -- an outcome stands, whether or not it can be explained
                    self.unexplained += 1
                    self._inexplicable = str(error) or type(error).__name__

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
        self.broken, self._revisable = reason, None
        self.engine = _Broken(self.complaint)

    def _ask_engine(self, view: View, time: int, signals: Mapping[str, Scalar], allowed: int = MAX_WORK) -> Outcome:
        if self.broken is not None:
            return Outcome.UNKNOWN
        engine = self.engine
        try:
            if allowed < MAX_WORK and isinstance(engine, Bounded):
                engine.allow(allowed)
                outcome = engine.step(time, view.matches(signals))
                engine.allow(MAX_WORK)
            else:
                outcome = engine.step(time, view.matches(signals))
        except Exception as error:  # noqa: BLE001 -- one engine's failure must not end a session
            self.give_up(str(error) or type(error).__name__)
            outcome = Outcome.UNKNOWN
        self.work = getattr(engine, "work", 0)
        return outcome

    def remember(self, verdict: int, outcome: Outcome) -> bool:
        """Record the outcome of verdict number `verdict`; true where the property became negative with it."""
        if outcome is self.outcome:
            return False
        self.outcome = outcome
        if outcome is Outcome.UNKNOWN:
            return False
        was, self.negative = self.negative, outcome in NEGATIVE
        if was or not self.negative:
            return False
        self.violations += 1
        self.first_violation = self.first_violation or verdict
        return True

    def note_first(self, verdict: int, step: int | None, at: int) -> None:
        """Where verdict number `verdict` is the first violation: the number of its step, and its stamp (ns)."""
        if verdict == self.first_violation:
            self.first_violation_step, self.first_violation_at = step, at
