"""Reports of events that are lost here: once for each cause, as there may be many losses."""

from __future__ import annotations

import re
from typing import Optional, Set

from oracle_adapter.errors import LinkError

_STREAM = re.compile(r'"stream":("[^"]*")')


def too_large(body: str) -> str:
    """Why an event with this JSON can't be sent."""
    stream = _stream_of(body)
    of = f" of {stream}" if stream else ""
    return f"an event{of} is too large for a frame: what is read of it takes {len(body):,} bytes"


def _stream_of(body: str) -> str:
    """The stream of an event, as its JSON has it."""
    name = _STREAM.match(body)
    return name[1] if name else ""


class Losses:
    """The causes that were reported."""

    def __init__(self) -> None:
        self._large: Set[str] = set()  # the streams with an event that was too large
        self.is_full = False
        """Whether a full queue was reported, and has had no room since."""

    def large(self, body: str) -> Optional[LinkError]:
        """The report of an event that is too large; None where there was one of its stream."""
        stream = _stream_of(body)
        if stream in self._large:
            return None
        self._large.add(stream)
        more = "more of this is counted and not reported"
        return LinkError("lost", f"{too_large(body)}; {more}")

    def full(self, count: int) -> Optional[LinkError]:
        """The report of an event for which a queue of so many has no room; None after one."""
        reported, self.is_full = self.is_full, True
        more = "what comes until there is room is counted as lost"
        return (
            None if reported else LinkError("lost", f"the queue of {count} events is full; {more}")
        )
