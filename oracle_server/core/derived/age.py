"""How long ago something held."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection
from typing import Any

import msgspec

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.flips import turning_ages
from oracle_server.core.derived.samples import FAILED, Value
from oracle_server.core.derived.window import Asked, Session
from oracle_server.core.events import Signals

SECOND = 10**9


def seconds(age: int) -> float:
    """An age (ns) as formulas see it."""
    return age / SECOND


class Age:
    """Seconds since it held; before that, since the session began."""

    __slots__ = ("_failed", "_session", "_since", "last")

    def __init__(self, _definition: Definition, session: Session) -> None:
        self._session = session
        self._since: int | None = None
        self._failed = False
        """Whether it is not known if it held later."""
        self.last = 0
        """The number of the step at which it held last."""

    def take(self, sample: Value, now: int, number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """It holds now, or it is not known whether; returns the age."""
        if self._session.journal.entries is not None:
            self._session.journal.entries.append(_Held(self, self._since, self.last, self._failed))
        self._failed = sample is FAILED
        if self._failed:
            return FAILED
        self._since, self.last = now, number
        return 0.0

    def value(self, now: int, _number: int, _signals: Signals, _failed: Collection[str]) -> Value | None:
        """The age at a step."""
        if self._failed:
            return FAILED
        since = self._since if self._since is not None else self._session.begun
        return None if since is None else (now - since) / SECOND

    def at(self, now: int, number: int, signals: Signals, failed: Collection[str]) -> Value | None:
        """The age at a tick."""
        return self.value(now, number, signals, failed)

    def next_change(self, after: int, asked: Asked) -> int | None:
        """When it is so old that an answer turns."""
        since = self._since if self._since is not None else self._session.begun
        if since is None or self._failed:
            return None
        ages = turning_ages(tuple(asked), seconds)
        index = bisect_right(ages, after - since)
        return since + ages[index] if index < len(ages) else None

    def settled(self, _now: int, _number: int) -> bool:
        """Whether it never held."""
        return self._since is None and not self._failed

    def snapshot(self) -> Any:
        """It as plain data."""
        return [self._since, self._failed, self.last]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self._since, self._failed, self.last = data

    def become(self, since: int | None, last: int, failed: bool) -> None:
        """Be as it was."""
        self._since, self.last, self._failed = since, last, failed


class _Held(msgspec.Struct, frozen=True, gc=False):
    """Takes back that it held."""

    age: Age
    since: int | None
    last: int
    failed: bool

    def __call__(self) -> None:
        """Take it back."""
        self.age.become(self.since, self.last, self.failed)
