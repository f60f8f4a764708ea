"""Why a property stands as it does, and what went wrong in its engine."""

from __future__ import annotations

from collections.abc import Callable

from oracle_server.core.engine import Engine, Explaining, provides
from oracle_server.core.explanation import Why
from oracle_server.core.owing import AllUnanswered
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import FINAL, NEGATIVE, Outcome


class Explained:
    """The part of a property's state that asks its engine why."""

    __slots__ = ("_inexplicable", "negative", "outcome", "unexplained", "why")

    engine: Engine
    outcome: Outcome
    negative: bool
    asked: bool
    why: Why | None
    past: Callable[[], Past | None] | None
    lacking: Callable[[], str | None] | None
    unexplained: int
    unanswered: AllUnanswered
    _inexplicable: str

    @property
    def complaint(self) -> str | None:
        """What went wrong in the engine, None for nothing."""
        told = [getattr(self.engine, "complaint", None), None if self.lacking is None else self.lacking()]
        found: str | None = "; ".join(each for each in told if each) or None
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
        if self.asked or (outcome in NEGATIVE and (not self.negative or self.unanswered)):
            past = NO_PAST if self.past is None else self.past()
            self.why = None
            if past is not None and provides(self.engine, Explaining):
                try:
                    self.why = self.engine.explain(past)
                except Exception as error:  # noqa: BLE001 -- an outcome stands, whether or not it can be explained
                    self.unexplained += 1
                    self._inexplicable = str(error) or type(error).__name__
