"""Times of a trace that could not be read, or can't be meant: they are said, each with its first line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from oracle_server.core.spec import SECOND
from oracle_server.core.units import counted
from oracle_server.replay.recording import Note

_HOUR = 3600 * SECOND
_YEARS = range(10**9, 42 * 10**8)
"""The seconds since 1970 of this century."""
_BRIEF = SECOND // 1000
"""How long (ns) a trace may take at least whose times are suspected to be in another unit; else a day in that unit."""
_AS_BEFORE = "it counts as arrived with the line before"
_UNITS = (("seconds", 1), ("milliseconds", 10**3), ("microseconds", 10**6))
"""Units that are taken for nanoseconds, and how many make a second."""
_DAY = 86_400
_LIKE_TIMES = ("timestamp", "time_stamp", "timestamp_ns", "time_ns", "t", "ts", "stamp", "stamp_ns", "date", "datetime")
"""Names, in small letters, of keys that mostly say when a message was sent."""


@dataclass(slots=True)
class Times:
    """What is wrong with the times of a trace; `slack` is how much earlier (ns) than the line before one may arrive."""

    slack: int
    clocked: bool = True
    _faults: dict[str, tuple[str, int]] = field(default_factory=dict)
    _events: int = 0
    _timeless: int = 0
    _unread: str = ""
    _now: int = 0
    _first: int = 0
    _last: int = 0

    def note(self, place: str, reason: str, then: str) -> None:
        """Note a fault of one line, and `then`, what comes of it; where the same comes of several they are counted."""
        first, count = self._faults.get(then, (f"{place}: {reason}", 0))
        self._faults[then] = first, count + 1

    def look(self, place: str, arrived: int | None, stamp: int | None, fault: str) -> None:
        """Look at a line's time of arrival and its own stamp (ns); `fault`: one of them could not be read."""
        self._events += 1
        time = arrived if self.clocked else stamp
        if time:
            self._first, self._last = min(self._first or time, time), max(self._last, time)
        if self.clocked and arrived is None:
            self.note(place, fault or "it has no time of arrival", _AS_BEFORE)
        elif fault:
            self.note(place, fault, "the line has no time")
        elif not self.clocked and arrived is not None:
            self.note(place, "the first line has no time of arrival", "that of the line does not count")
        elif self.clocked and arrived is not None and arrived < self._now - self.slack:
            self.note(place, "it arrived before the line above it", _AS_BEFORE)
        unit = unit_of(stamp, arrived) if arrived and stamp else ""
        if unit:
            self.note(place, f"`stamp` is {stamp}, which are {unit}", "it is taken for nanoseconds")
        self._now = max(self._now, arrived or 0)

    def timeless(self, fields: Iterable[str]) -> None:
        """Count a line that says no time that is read, neither beside its message nor in one of its fields."""
        self._timeless += 1
        self._unread = self._unread or next((key for key in fields if key.lower() in _LIKE_TIMES), "")

    def notes(self, *, timed: bool) -> list[Note]:
        """All that is to be said; `timed`: some formula counts seconds."""
        found = [f"{first}: {then}{_such(count)}" for then, (first, count) in self._faults.items()]
        if not self.clocked and self._timeless and (timed or self._timeless < self._events):
            mend = (
                f"; `{self._unread}` is not read as one: name it in the spec, with its unit, as "
                f"`stamp: {{field: {self._unread}, unit: s}}` of its stream"
            )
            lines = f"{counted(self._timeless, 'line')} of {self._events}"
            found.append(f"no time passes where none is said: {lines}{mend if self._unread else ''}")
        return [*(Note(text, doubt=True) for text in found), *notes_of_span(self._first, self._last)]


def notes_of_span(first: int, last: int) -> Iterator[Note]:
    """What is to be said of a recording by its first and its last time (ns): they look like times in another unit."""
    took = last - first
    unit, size = next(((name, size) for name, size in _UNITS if first // size in _YEARS), ("", 0))
    if unit and 0 < took < max(_BRIEF, _DAY * size):
        text = f"its times look like {unit}, and are taken for nanoseconds: all lie within {took} ns"
        yield Note(text, doubt=True)


def unit_of(stamp: int, arrived: int) -> str:
    """The unit of a stamp that is as late as its arrival (ns) in that unit, and not in nanoseconds; empty for none."""
    if abs(stamp - arrived) <= _HOUR:
        return ""
    return next((name for name, size in _UNITS if abs(stamp * (SECOND // size) - arrived) < _HOUR), "")


def _such(count: int) -> str:
    return f" ({count} such lines)" if count > 1 else ""
