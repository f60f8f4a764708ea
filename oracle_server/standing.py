"""How the properties of a session stand, in the words that its monitors show to the robot's people."""

from __future__ import annotations

from typing import Any

from oracle_server.core.judge import Judge, PropertyState
from oracle_server.core.verdicts import Outcome, worst

_SAID = {
    Outcome.TRUE: ("ok", "holds for good"),
    Outcome.CURRENTLY_TRUE: ("ok", "holds"),
    Outcome.CURRENTLY_FALSE: ("warn", "does not hold at present"),
    Outcome.FALSE: ("error", "violated for good"),
}

Mark = tuple[tuple[Outcome, int, bool], ...]
"""What tells two standings apart: each property's outcome, its violations, and whether it could be judged so far."""


def mark(judge: Judge) -> Mark:
    """What changes with the standing, to be compared after each batch of steps."""
    return tuple([(state.outcome, state.violations, state.failures > 0) for state in judge.properties])


def verdicts_frame(judge: Judge, n: int) -> dict[str, Any]:
    """The `verdicts` frame; `n` is the number of the last verdict that it takes in."""
    return {
        "type": "verdicts",
        "n": n,
        "worst": worst(state.outcome for state in judge.properties).value,
        "properties": {state.property.id: _standing(state) for state in judge.properties},
    }


def _standing(state: PropertyState) -> dict[str, Any]:
    level, text = _SAID.get(state.outcome) or _unknown(state)
    return {
        "outcome": state.outcome.value,
        "level": level,
        "text": text,
        "violations": state.violations,
        "first_violation": state.first_violation,
    }


def _unknown(state: PropertyState) -> tuple[str, str]:
    if state.broken is not None:
        return "error", f"judged no more: {state.broken}"
    if state.failures:
        return "warn", "could not be judged at the last step"
    return "stale", "not judged yet"
