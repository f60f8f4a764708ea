"""How a property came to stand as it does: its violations, and which one was the first."""

from __future__ import annotations

from oracle_server.core.judging.explained import Explained
from oracle_server.core.owing import Owed
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import FINAL, NEGATIVE, Outcome


class Counted(Explained):
    """The part of a property's state that counts its violations."""

    __slots__ = (
        *("failures", "first_violation", "first_violation_at", "first_violation_step"),
        *("lasts", "unanswered", "violations"),
    )

    failures: int
    property: Property
    owed: Owed | None
    lasts: bool
    """Whether what is negative now goes on, as the error of a machine; that a state was not left is an instant."""
    first_violation: int | None
    first_violation_at: int | None
    first_violation_step: int | None
    violations: int

    def remember(self, verdict: int, outcome: Outcome) -> bool:
        """Record the outcome of verdict number `verdict`; true where the property became negative with it."""
        unanswered = self.unanswered.count if self.outcome not in FINAL else 0
        if unanswered:
            return self._count(verdict, outcome, unanswered)
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

    def _count(self, verdict: int, outcome: Outcome, violations: int) -> bool:
        """Count each obligation that was not answered; true where these are violations."""
        self.outcome, self.negative = outcome, outcome in NEGATIVE and self.lasts
        if outcome not in NEGATIVE:
            return False
        self.violations += violations
        self.first_violation = self.first_violation or verdict
        return True

    def take_unanswered(self, *, tick: bool) -> None:
        """Take what obligations were decided with the last step, or by the time that came last, a `tick`.

        Each step of a machine that is in an error misses what it asks for itself; as long as that lasts it is once.
        """
        if self.owed is None:
            return
        self.unanswered = self.owed.unanswered()
        self.failures += self.owed.lost
        if self.property.says == "machine":
            self.lasts = self.negative if tick else self.unanswered.at_once > 0
            if self.negative and self.lasts:
                self.unanswered = self.unanswered.earlier

    def note_first(self, verdict: int, step: int | None, at: int) -> None:
        """Where verdict number `verdict` is the first violation: the number of its step, and its stamp (ns)."""
        if verdict == self.first_violation:
            self.first_violation_step, self.first_violation_at = step, at
