"""The steps that triggered obligations, with their events, as long as some of these are open.

Very many may be open, so long texts are shortened in what is kept of an event; beyond `ROOM` its signals are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import msgspec

from oracle_server.core.atoms import shortened
from oracle_server.core.records import EventRecord
from oracle_server.engines.native.timeline import Timeline

ROOM = 2**24
"""Characters of the signals of all events that are kept, with their names."""
_NUMBER = 16
"""As many count for a signal that is no text."""


class Opened(msgspec.Struct, gc=False):
    """The event of a step of which some obligations are open, the characters of its signals, and how many are open."""

    event: EventRecord
    length: int
    count: int = 0


class Triggers:
    """The triggers of what is open, by the numbers of their steps."""

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline
        self._opened: dict[int, Opened] = {}
        self._length = 0
        """Characters of the signals of all of them."""

    def open(self, number: int, event: Callable[[], EventRecord]) -> None:
        """One more obligation of a step is open; `event` tells the step's."""
        opened, journal = self._opened.get(number), self._timeline.journal
        if opened is None:
            if journal is not None:
                journal.append(partial(setattr, self, "_length", self._length))
                journal.append(partial(self._opened.pop, number))
            opened = self._add(number, event())
        opened.count += 1

    def close(self, number: int) -> EventRecord:
        """One obligation of a step is decided: the step's event."""
        opened, journal = self._opened[number], self._timeline.journal
        if journal is not None:
            journal.append(partial(setattr, opened, "count", opened.count))
            journal.append(partial(self._opened.__setitem__, number, opened))
            journal.append(partial(setattr, self, "_length", self._length))
        opened.count -= 1
        if not opened.count:
            del self._opened[number]
            self._length -= opened.length
        return opened.event

    def snapshot(self) -> Any:
        """All of them as plain data."""
        return [(number, found.event, found.count) for number, found in self._opened.items()]

    def restore(self, data: Iterable[tuple[int, EventRecord, int]]) -> None:
        """Take over a snapshot."""
        for number, event, count in data:
            self._add(number, event).count = count

    def _add(self, number: int, event: EventRecord) -> Opened:
        """Keep the event of a step, as far as there is room."""
        signals = {name: shortened(value) for name, value in event["signals"].items()}
        length = sum(len(name) + (len(value) if isinstance(value, str) else _NUMBER) for name, value in signals.items())
        if self._length + length > ROOM:
            signals, length = {}, 0
        self._length += length
        opened = self._opened[number] = Opened({**event, "signals": signals}, length)
        return opened
