"""The kinds of streams, and what an adapter must know of each: one row a kind.

Another type of interface is a row for each of its kinds here, and in each adapter a file that
observes it and a row in `parts.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Mapping, Optional

InterfaceType = Literal["topic", "service", "action"]


@dataclass(frozen=True)
class Kind:
    """One kind of streams."""

    name: str
    """What the wire calls it."""
    of: InterfaceType
    """What a stream of it belongs to."""
    event: str
    """What people call an event of it."""
    answers: Optional[str] = None
    """The kind whose events are answered by events of this one."""
    has_call: bool = False
    """Whether a number pairs its events with those of other kinds."""
    passes_when_undecided: bool = False
    """Whether an event passes where there is no decision, whatever the spec says."""
    can_be_withheld: bool = True
    """Whether an adapter can keep an event of it from those for whom it is meant."""


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("topic", of="topic", event="message"),
        Kind("request", of="service", event="request", has_call=True),
        Kind("response", of="service", event="response", has_call=True, answers="request"),
        Kind("goal", of="action", event="goal", has_call=True),
        Kind("reply", of="action", event="reply", has_call=True, answers="goal"),
        Kind("feedback", of="action", event="feedback message"),
        # a robot must be stopped, with an oracle or without
        Kind("cancel", of="action", event="cancel", has_call=True, passes_when_undecided=True),
        Kind("result", of="action", event="result"),
        Kind("status", of="action", event="status", can_be_withheld=False),
    )
}
