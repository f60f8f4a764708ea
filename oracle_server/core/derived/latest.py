"""The last samples: the last one, the one before it, and their difference."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial
from typing import Any

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.samples import FAILED, NOTHING, Value, known
from oracle_server.core.derived.window import Asked, Session
from oracle_server.core.events import Signals

_LONG = 4_096
"""Characters of a text that is kept for each of many keys."""


class Last:
    """The last sample."""

    __slots__ = ("_before", "_keyed", "_last", "_of", "_session", "last")

    def __init__(self, definition: Definition, session: Session) -> None:
        self._session, self._of, self._keyed = session, definition.of, bool(definition.by)
        self._last: Value = NOTHING
        self._before: Value = NOTHING
        self.last = 0
        """The number of the step of the last sample."""

    def take(self, sample: Value, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """Add a sample; returns what the signal is with it."""
        if self._keyed and isinstance(sample, str) and len(sample) > _LONG:
            sample = FAILED  # thousands of keys would keep one each
        if self._session.journal.entries is not None:
            self._session.journal.entries.append(partial(self._become, self._before, self._last, self.last))
        self._before, self._last, self.last = self._last, sample, number
        return self.value(now, number, signals, failed)

    def value(self, _now: int, _number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The last sample."""
        return None if self._last is NOTHING else self._last

    def at(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """The same at a tick."""
        return self.value(now, number, signals, failed)

    def next_change(self, _after: int, _asked: Asked) -> int | None:
        """Time alone changes nothing."""
        return None

    def settled(self, _now: int, _number: int) -> bool:
        """Whether there was none."""
        return self._last is NOTHING

    def snapshot(self) -> Any:
        """The samples as plain data."""
        return [_saved(self._before), _saved(self._last), self.last]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        before, last, self.last = data
        self._before, self._last = _restored(before), _restored(last)

    def _become(self, before: Value, last: Value, number: int) -> None:
        self._before, self._last, self.last = before, last, number


class Previous(Last):
    """The sample before the last one, where the signal is there."""

    __slots__ = ()

    def value(self, _now: int, _number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """The sample before."""
        if self._of not in signals and self._of not in failed:
            return None
        if self._last is FAILED or self._before is FAILED:
            return FAILED
        return None if self._before is NOTHING else self.worth(self._before, self._last)

    def worth(self, before: Value, _last: Value) -> Value:
        """The signal of two samples, both of which are known."""
        return before


class Delta(Previous):
    """The last sample minus the one before it."""

    __slots__ = ()

    def worth(self, before: Value, last: Value) -> Value:
        """The difference."""
        return known(last - before)  # type: ignore[operator] # others are `FAILED`


def _saved(value: Value) -> Any:
    return [] if value is NOTHING else [None] if value is FAILED else [value]


def _restored(data: Any) -> Value:
    if not data:
        return NOTHING
    value: Value = data[0]
    return FAILED if data[0] is None else value
