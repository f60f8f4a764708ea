"""The steps that triggered obligations, with their events, as long as some of these are open."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import msgspec

from oracle_server.core.records import EventRecord
from oracle_server.engines.native.timeline import Timeline


class Opened(msgspec.Struct, gc=False):
    """The event of a step of which some obligations are open, and how many."""

    event: EventRecord
    count: int = 0


class Triggers:
    """The triggers of what is open, by the numbers of their steps."""

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline
        self._opened: dict[int, Opened] = {}

    def open(self, number: int, event: Callable[[], EventRecord]) -> None:
        """One more obligation of a step is open; `event` tells the step's."""
        opened, journal = self._opened.get(number), self._timeline.journal
        if opened is None:
            opened = self._opened[number] = Opened(event())
            if journal is not None:
                journal.append(partial(self._opened.pop, number))
        opened.count += 1

    def close(self, number: int) -> EventRecord:
        """One obligation of a step is decided: the step's event."""
        opened, journal = self._opened[number], self._timeline.journal
        if journal is not None:
            journal.append(partial(setattr, opened, "count", opened.count))
            journal.append(partial(self._opened.__setitem__, number, opened))
        opened.count -= 1
        if not opened.count:
            del self._opened[number]
        return opened.event

    def snapshot(self) -> Any:
        """All of them as plain data."""
        return [(number, found.event, found.count) for number, found in self._opened.items()]

    def restore(self, data: Iterable[tuple[int, EventRecord, int]]) -> None:
        """Take over a snapshot."""
        self._opened = {number: Opened(event, count) for number, event, count in data}
