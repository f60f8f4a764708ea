"""When messages were published; times since a robot's start as times since 1970, by one clock a monitor."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Hashable

from oracle_server.core.events import Event
from oracle_server.core.stamps import Stamp, since_boot_in, stamp_in

_LATEST = 2**63 - 1
"""As late as a time can be."""
_MOST_KNOTS = 16
_MOST_PUBLISHERS = 1_000
"""Whose newest times are kept; of more, the first heard are forgotten."""


class BootClock:
    """Tells when a message was published, by how long that was after the robot's start. All times are nanoseconds.

    Later messages are never told to be earlier ones, whatever their delays: among messages without another time of
    publication, the order is that of their own stamps.
    """

    def __init__(self, max_skew: int) -> None:
        """`max_skew` is how far a message may lie ahead of what is known of its time otherwise."""
        self._max_skew = max_skew
        self._knots: list[tuple[int, int]] = []
        """Times since the start with those since 1970, both rising; straight lines lead from one to the next."""
        self._highest = 0
        self._newest: dict[Hashable, int] = {}

    def place(self, source: Hashable, since: int, known: int) -> int:
        """The time of a publisher's message, sent `since` the start, and at `known` as the middleware or arrival says.

        The first one fixes the clock. It is fixed anew where a publisher's time falls back by more than `max_skew`, as
        when the robot starts anew; and set back, no further than behind the newest message, where a message would lie
        further ahead than that, as after a first one that came late.
        """
        before = self._newest.get(source)
        if not self._knots or (before is not None and since < before - self._max_skew):
            self._knots, self._newest, self._highest = [(since, known)], {}, since
        elif since > self._highest and self._at(since) > known + self._max_skew:
            top = self._at(self._highest)
            self._knots += [(self._highest, top), (since, max(known, top + 1))]
            del self._knots[:-_MOST_KNOTS]
        self._highest = max(self._highest, since)
        self._newest[source] = max(self._newest.get(source, since), since)
        if len(self._newest) > _MOST_PUBLISHERS:
            del self._newest[next(iter(self._newest))]
        return min(max(1, self._at(since)), _LATEST)

    def _at(self, since: int) -> int:
        i = bisect_right(self._knots, since, key=lambda knot: knot[0])
        if 0 < i < len(self._knots):
            (x0, y0), (x1, y1) = self._knots[i - 1 : i + 1]
            return y0 + (since - x0) * (y1 - y0) // (x1 - x0)
        x, y = self._knots[0 if i == 0 else -1]
        return y + since - x


class PublicationTimes:
    """Tells when the events of a session were published; a clock that a robot's start sets is its first message's."""

    def __init__(self, max_skew: int) -> None:
        """`max_skew` (ns) as for `BootClock`."""
        self._boots: defaultdict[str, BootClock] = defaultdict(lambda: BootClock(max_skew))

    def stamp(self, event: Event, where: Stamp | None, arrived: int | None) -> int | None:
        """An event's publication time (ns): what the monitor said, or what the server reads of the message itself.

        `arrived` is in the session's time, None where no clock has told that yet: then no clock of a robot is fixed.
        """
        if where is None or where.plain:
            return event.stamp or stamp_in(event.data, where)
        if where.epoch == "unix":
            return stamp_in(event.data, where) or event.stamp
        since_boot = since_boot_in(event.data, where)
        if since_boot is None:
            return event.stamp
        known = event.stamp or arrived
        if known is None:
            return None
        return self._boots[event.monitor].place((event.stream, event.source), since_boot, known)
