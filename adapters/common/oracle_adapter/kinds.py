"""The kinds of streams, and what an adapter must know of each: one row a kind.

Another type of interface, such as ROS's actions, is a row for each of its kinds here, and in each
adapter a file that observes it and a row in `parts.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Mapping, Optional

InterfaceType = Literal["topic", "service"]


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
    can_be_withheld: bool = True
    """Whether an adapter can keep an event of it from those for whom it is meant."""


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("topic", of="topic", event="message"),
        Kind("request", of="service", event="request", has_call=True),
        Kind("response", of="service", event="response", has_call=True, answers="request"),
    )
}
