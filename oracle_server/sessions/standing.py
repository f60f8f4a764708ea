"""The `verdicts` frame: the state of a session's properties, as text that adapters show to operators."""

from __future__ import annotations

from oracle_server.core.judge import Judge
from oracle_server.core.property_state import PropertyState
from oracle_server.core.verdicts import Outcome, worst
from oracle_server.wire.frames import Level, PropertyStanding, VerdictsFrame

_WORDING: dict[Outcome, tuple[Level, str]] = {
    Outcome.TRUE: ("ok", "holds for good"),
    Outcome.CURRENTLY_TRUE: ("ok", "holds"),
    Outcome.CURRENTLY_FALSE: ("warn", "does not hold at present"),
    Outcome.FALSE: ("error", "violated for good"),
}


class Standing:
    """Follows the properties of the order that decides, from the first monitor on that requests `verdicts` frames."""

    def __init__(self, judge: Judge) -> None:
        self.committed: VerdictsFrame | None = None
        """The frame as of the last commit; None while no monitor has requested it."""
        self._judge = judge
        self._mark: tuple[tuple[Outcome, int, bool], ...] = ()

    def follow(self, n: int) -> None:
        """Begin to follow; the verdicts up to number `n` are written, if not committed yet."""
        if self.committed is None:
            self._mark, self.committed = self._marked(), _frame(self._judge, n)

    def changed(self, n: int) -> VerdictsFrame | None:
        """The frame to send once the verdicts up to `n` are committed, None where nothing has changed."""
        if self.committed is None:
            return None
        before, self._mark = self._mark, self._marked()
        return None if self._mark == before else _frame(self._judge, n)

    def _marked(self) -> tuple[tuple[Outcome, int, bool], ...]:
        """For each property: its outcome, its violations, and whether any step could not be judged."""
        return tuple([(state.outcome, state.violations, state.failures > 0) for state in self._judge.properties])


def _frame(judge: Judge, n: int) -> VerdictsFrame:
    return {
        "type": "verdicts",
        "n": n,
        "worst": worst(state.outcome for state in judge.properties).value,
        "properties": {state.property.id: _standing(state) for state in judge.properties},
    }


def _standing(state: PropertyState) -> PropertyStanding:
    level, text = _WORDING.get(state.outcome) or _unknown(state)
    return {
        "outcome": state.outcome.value,
        "level": level,
        "text": text,
        "violations": state.violations,
        "first_violation": state.first_violation,
    }


def _unknown(state: PropertyState) -> tuple[Level, str]:
    if state.broken is not None:
        return "error", f"no longer judged: {state.broken}"
    if state.failures:
        return "warn", "could not be judged at the last step"
    return "stale", "not judged yet"
