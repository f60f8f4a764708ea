"""A property that an external oracle judges: its answer is received before each step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oracle_server.core.engine import Answer
from oracle_server.core.errors import EngineError
from oracle_server.core.explanation import Reason, Why
from oracle_server.core.past import NO_PAST, Past
from oracle_server.core.verdicts import NEGATIVE, Outcome


class ExternalEngine:
    """Returns the last answer; it still holds at steps of streams that the oracle does not receive."""

    def __init__(self, text: str) -> None:
        """`text` describes the oracle to people."""
        self._text = text
        self._answer = Answer(Outcome.UNKNOWN, "was not asked yet")
        self._unknown, self._last = 0, ""

    @property
    def complaint(self) -> str | None:
        """How often the oracle gave no verdict, and the latest reason; None where it always did."""
        if not self._unknown:
            return None
        times = "once" if self._unknown == 1 else f"{self._unknown} times"
        return f"{self._text} left steps unknown {times}; the last time it {self._last}"

    def receive(self, answer: Answer) -> None:
        """Use an answer for the next step."""
        self._answer = answer
        if answer.outcome is Outcome.UNKNOWN:
            self._unknown += 1
            self._last = answer.text

    def step(self, time: int, matches: object) -> Outcome:  # noqa: ARG002 -- the oracle is sent the event itself
        """The outcome of the last answer."""
        return self._answer.outcome

    def explain(self, past: Past = NO_PAST) -> Why:  # noqa: ARG002 -- as every engine
        """The oracle's reply."""
        holds = self._answer.outcome not in NEGATIVE
        return Why(holds, {}, 0, (Reason(self._text, holds, self._answer.text),))

    def snapshot(self) -> dict[str, Any]:
        """The last answer; the oracle keeps its own state."""
        return {"outcome": self._answer.outcome.value, "said": self._answer.text}

    def restore(self, data: Mapping[str, Any]) -> None:
        """Continue from a snapshot. Raises `EngineError` for one of another engine."""
        try:
            self._answer = Answer(Outcome(data["outcome"]), str(data["said"]))
        except (KeyError, ValueError, TypeError) as error:
            raise EngineError(f"no snapshot of an external oracle: {error}") from None
