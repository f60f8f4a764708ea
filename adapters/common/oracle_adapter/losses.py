"""Reports of events that are lost here: once for each cause, as there may be many losses."""

from __future__ import annotations

import json
import re
from typing import Dict, Optional, Tuple

from oracle_adapter.errors import LinkError

_PLACE = re.compile(r'"stream":("[^"]*")(?:,"kind":"([^"]*)")?')


def too_large(body: str) -> str:
    """Why an event with this JSON can't be sent."""
    stream, _ = place_of(body)
    of = f' of "{stream}"' if stream else ""
    return f"an event{of} is {_too_large(body)}"


def place_of(body: str) -> Tuple[str, str]:
    """The stream of an event and its kind, as its JSON has them."""
    place = _PLACE.match(body)
    return (json.loads(place[1]), place[2] or "") if place else ("", "")


def _too_large(body: str) -> str:
    return f"too large for a frame: what is read of it takes {len(body):,} bytes or more"


class Losses:
    """The causes that were reported."""

    def __init__(self) -> None:
        self._large: Dict[Tuple[str, str], str] = {}  # what to say of streams, by their kinds, too
        self.is_full = False
        """Whether a full queue was reported, and has had no room since."""

    def large(self, body: str) -> Optional[LinkError]:
        """The report of an event that is too large; None where there was one of its stream."""
        place = place_of(body)
        if place in self._large:
            return None
        self._large[place] = f"events are lost, the first one was {_too_large(body)}"
        more = "more of this is counted and not reported"
        return LinkError("lost", f"{too_large(body)}; {more}")

    def of(self, stream: str, kind: str) -> str:
        """What is wrong with a stream for good: some of it was never sent; else empty."""
        return self._large.get((stream, kind), "")

    def full(self, count: int) -> Optional[LinkError]:
        """The report of an event for which a queue of so many has no room; None after one."""
        reported, self.is_full = self.is_full, True
        more = "what comes until there is room is counted as lost"
        return (
            None if reported else LinkError("lost", f"the queue of {count} events is full; {more}")
        )
