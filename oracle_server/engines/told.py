"""A property that an oracle elsewhere judges: what it says is handed in before each step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oracle_server.core.engine import Answer
from oracle_server.core.errors import EngineError
from oracle_server.core.explanation import Reason, Why
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import NEGATIVE, Outcome


class ExternalEngine:
    """Says what it was told last; at steps that the oracle does not hear, what it said last stands."""

    def __init__(self, text: str) -> None:
        """`text` is what people are told of the oracle."""
        self._text = text
        self._answer = Answer(Outcome.UNKNOWN, "was not asked yet")
        self._unknown, self._last = 0, ""

    @property
    def complaint(self) -> str | None:
        """Why the oracle could not be believed, most recently, and how often; None for never."""
        if not self._unknown:
            return None
        times = "once" if self._unknown == 1 else f"{self._unknown} times"
        return f"{self._text} left steps unknown {times}; the last time it {self._last}"

    def tell(self, answer: Answer) -> None:
        """Take in what is said of the next step."""
        self._answer = answer
        if answer.outcome is Outcome.UNKNOWN:
            self._unknown += 1
            self._last = answer.said

    def step(self, time: int, matches: object) -> Outcome:  # noqa: ARG002 -- the oracle has both from elsewhere
        """What was said of the step."""
        return self._answer.outcome

    def explain(self, past: Past = NO_PAST) -> Why:  # noqa: ARG002 -- as every engine
        """Whose word it is."""
        holds = self._answer.outcome not in NEGATIVE
        return Why(holds, {}, 0, (Reason(self._text, holds, self._answer.said),))

    def snapshot(self) -> dict[str, Any]:
        """What was said last; the oracle's own state is elsewhere."""
        return {"outcome": self._answer.outcome.value, "said": self._answer.said}

    def restore(self, data: Mapping[str, Any]) -> None:
        """Go on where a snapshot was taken. Raises `EngineError` for one of another engine."""
        try:
            self._answer = Answer(Outcome(data["outcome"]), str(data["said"]))
        except (KeyError, ValueError, TypeError) as error:
            raise EngineError(f"no snapshot of an external oracle: {error}") from None
