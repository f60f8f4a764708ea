"""The native engine with reelay beside it: native's verdicts, and the first step at which reelay differs."""

from __future__ import annotations

from oracle_server.core.atoms import Matches
from oracle_server.core.engine import Engine
from oracle_server.core.errors import EngineError
from oracle_server.core.explanation import Why
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import NEGATIVE, Outcome
from oracle_server.engines.native import NativeEngine


class BothEngine:
    """Two engines stepped side by side."""

    def __init__(self, native: NativeEngine, other: Engine) -> None:
        """`other` is compared for as long as it can judge."""
        self._native = native
        self._other: Engine | None = other
        self._steps = 0
        self.complaint: str | None = None
        """What the engines differed on first, None while they agree."""

    def step(self, time: int, matches: Matches) -> Outcome:
        """Judge the next step as the native engine does."""
        self._steps += 1
        outcome = self._native.step(time, matches)
        if self._other is not None:
            try:
                other = self._other.step(time, matches)
            except EngineError:
                self._other = None
            else:
                self._compare(outcome, other)
        return outcome

    @property
    def work(self) -> int:
        """What the last step cost the native engine; reelay's cost can't be counted."""
        return self._native.work

    def allow(self, work: int) -> None:
        """Let the native engine look at so many values for a step; see `Bounded.allow`."""
        self._native.allow(work)

    def explain(self, past: Past = NO_PAST) -> Why:
        """Why the formula holds, or does not, at the last step; see `Explaining.explain`."""
        return self._native.explain(past)

    def _compare(self, outcome: Outcome, other: Outcome) -> None:
        if (outcome in NEGATIVE) is not (other in NEGATIVE) and self.complaint is None:
            self.complaint = f"at step {self._steps} native says {outcome.value}, and reelay {other.value}"
