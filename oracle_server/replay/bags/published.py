"""When the messages of a file were published, where it has that beside the times of their recording, as MCAP has."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.spec import SECOND
from oracle_server.core.units import counted
from oracle_server.replay.doubts.delays import DAY
from oracle_server.replay.recording import Note

_YEAR = 365 * 86_400 * SECOND
"""No robot runs for so long; what is older is by another clock, as that of a simulation."""


class Published:
    """Takes a message's time of publication for what it is, or not; `max_skew` (ns) is how far it may lie ahead."""

    def __init__(self, max_skew: int, max_delay: int | None) -> None:
        self.since = 0
        """When the recording began (ns): what was published more than `max_delay` (ns) before that was kept for it."""
        self._max_skew, self._max_delay = max_skew, max_delay or 0
        self._others = 0
        self._newest: dict[str, int] = {}
        """By topic."""

    def of(self, topic: str, recorded: int, published: int) -> int | None:
        """When a message was published (ns); None where nothing but the time of its recording is known of that.

        By the format both are the same where the former is not known; some writers have 0 then. Who published it is not
        told: one that was published before another one of its topic that came earlier stands at the time of that, and
        never behind its own recording, as nothing older is waited for on a topic.
        """
        if published in (0, recorded):
            return None
        if recorded - DAY <= published <= recorded + self._max_skew:
            if published < self.since - self._max_delay:  # nobody recorded then what would have answered it
                return None
            newest = self._newest[topic] = max(published, self._newest.get(topic, 0))
            return published if published == newest else min(newest, max(published, recorded))
        self._others += 1
        return None

    def heard(self, stamp: int | None, recorded: int) -> int | None:
        """When a message of a topic that lasts counts as published (ns): when it was `recorded`, if kept until then.

        By its stamp it would stand where nothing else was recorded, and all that came would be missing for as long.
        """
        return recorded if stamp is not None and self.since - _YEAR < stamp < self.since else stamp

    def notes(self) -> Iterator[Note]:
        """What is to be said of those that were not taken."""
        if self._others:
            what = f"{counted(self._others, 'message')} of which the publish time is needed"
            yield Note(f"{what}: it is by another clock than that of the recording, and arrivals count instead")
