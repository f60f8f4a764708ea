"""The answer to an ask, and what to do with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Mapping, Optional, Tuple

if TYPE_CHECKING:
    from oracle_adapter.queued import Queued

Why = Literal["decision", "timeout", "unavailable"]
Policy = Literal["deny", "pass"]


@dataclass(frozen=True)
class Answer:
    """The answer to an ask: the server's decision, or why there is none.

    `decision` is given where `why` is `decision`; `reason` is a text why there is none, or why it
    is `deny` though no property denies: what can't be judged is denied.
    `denied_by` names properties, `verdicts` gives properties' outcomes at the event.
    """

    why: Why
    decision: Optional[Literal["allow", "deny"]] = None
    denied_by: Tuple[str, ...] = ()
    verdicts: Mapping[str, str] = field(default_factory=dict)
    reason: str = ""
    event: Optional[Queued] = field(default=None, repr=False, compare=False)

    @property
    def seq(self) -> Optional[int]:
        """The event's number on the wire; None while it has none, or where it was never queued."""
        return None if self.event is None else self.event.seq


def denied(reason: str, event: Optional[Queued] = None) -> Answer:
    """What the oracle is there for and can't judge is `unknown`, and denied: that is no outage."""
    return Answer("decision", "deny", reason=reason, event=event)


def should_pass(answer: Answer, on_unavailable: Policy) -> Tuple[bool, Why]:
    """Return whether to forward the event and why: by the decision, else by the stream's policy."""
    if on_unavailable not in ("deny", "pass"):
        raise ValueError(f"on_unavailable must be 'deny' or 'pass', not {on_unavailable!r}")
    if answer.why == "decision":
        return answer.decision == "allow", "decision"
    return on_unavailable == "pass", answer.why
