"""Leaps in the times of a recording: where a clock was set, or a time is wrong, time alone decides much."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.naming import moment
from oracle_server.core.spec import SECOND

_YEAR = 365 * 24 * 3600 * SECOND
"""For so long no recorder waits for the next message."""


class Leaps:
    """Looks at the times of arrival, and finds those that come more than a year behind the one before."""

    def __init__(self) -> None:
        """Begin with nothing seen."""
        self._last: int | None = None
        self._first: tuple[int, int] | None = None
        self._count = 0

    def look(self, time: int) -> None:
        """Look at the next time (ns); one that is earlier than those before is no matter."""
        if self._last is not None and time - self._last > _YEAR:
            self._first = self._first or (self._last, time)
            self._count += 1
        self._last = max(self._last or 0, time)

    def doubts(self) -> Iterator[str]:
        """What is to be said of them, in a line."""
        if self._first is not None:
            before, after = self._first
            more = f" ({self._count} times in all)" if self._count > 1 else ""
            what = f"nothing arrived for {(after - before) / _YEAR:.3g} years, from {moment(before, after)}"
            yield (
                f"{what} to {moment(after, before)}{more}: a clock was set, or a time is wrong; deadlines between "
                "these times ran out"
            )
