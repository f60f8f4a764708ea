"""`once[a:]` of what can't hold for fresh values: the keys at which it held, and a queue of those that must wait."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Collection, Iterator
from itertools import chain
from typing import Any

from oracle_server.engines.native.body import NOTHING, Body
from oracle_server.engines.native.held import Held
from oracle_server.engines.native.keys import Key, Region, read_key
from oracle_server.engines.native.nodes import texts_at
from oracle_server.engines.native.timeline import FEW, Timeline, Undo


class Ever:
    """Once it holds at a key, it holds there from then on."""

    __slots__ = (
        "_at",
        "_body",
        "_clock",
        "_held",
        "_lower",
        "_timeline",
        "at",
        "binds",
        "changes",
        "flat",
        "held",
        "multiplies",
        "variables",
        "waiting",
        "waits",
    )  # fmt: skip
    lasting = True

    def __init__(self, body: Body, lower: int, timeline: Timeline, clock: Timeline | None = None) -> None:
        """`clock` has the times of the steps, None where these are the timeline's."""
        self._body, self._lower, self._timeline, self._clock = body, lower, timeline, clock or timeline
        self._at = body.at[0]
        self.variables = body.variables
        self.flat, self.binds, self.multiplies = True, frozenset(body.variables), body.multiplies
        self.changes: list[Key] = []
        self._held = Held(len(self.variables), timeline, counted=body.multiplies)
        self.held = self._held.times
        """Where it holds, and the first time at which the operand did."""
        self.waiting: deque[tuple[int, Key]] = deque()
        """When it will have held long enough ago, and where; `waits` are these keys."""
        self.waits: set[Key] = set()
        self.at = self.held.__contains__

    def step(self) -> None:
        """Take what changed below."""
        if self.changes:
            self.changes = []
        keys = self._body.touched(NOTHING)
        if keys:
            at, held = self._at, self.held
            for key in keys:
                if key not in held and at(key):
                    if not self._lower:
                        self._hold(key, self._clock.now)
                    elif key not in self.waits:
                        self._wait(key)
        if self.waiting:
            self._release()

    def due(self) -> int | None:
        """When this must be stepped even if nothing changes below."""
        return self.waiting[0][0] if self.waiting else None

    def next_deadline(self, after: int) -> int | None:
        """The first time later than `after` at which the value may change without a step."""
        place = bisect_right(self.waiting, after, key=_deadline)
        return self.waiting[place][0] if place < len(self.waiting) else None

    def points(self) -> Collection[Key]:
        """The keys at which it holds."""
        return self.held

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of the keys in a region."""
        return self._held.spread(region, place)

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        return self._held.constant(region)

    def when(self, key: Key) -> int | None:
        """The time of a step that makes it hold at a key."""
        return self.held.get(key)

    def snapshot(self) -> Any:
        """The state as plain data."""
        return [list(self.held.items()), list(self.waiting)]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        held, waiting = data
        for key, time in held:
            self._hold(read_key(key), time)
        self.waiting.extend((deadline, read_key(key)) for deadline, key in waiting)
        self.waits.update(key for _, key in self.waiting)

    def apart(self, variable: int) -> Iterator[str]:
        """The texts at which it holds, or will, and those that are distinguished below."""
        own = texts_at(chain(self.held, self.waits), self.variables, variable)
        return chain(own, self._body.apart(variable))

    def settled(self, key: Key) -> bool | None:
        """True once it holds."""
        if key in self.held:
            return True
        return None if key in self.waits else (False if self._body.settled[0](key) is False else None)

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        return fresh.isdisjoint(self.variables), self._body.can_settle[0](fresh)[1]

    def index(self) -> None:
        """Prepare for `spread`."""
        self._held.index()

    def _release(self) -> None:
        now, released = self._clock.now, 0
        while self.waiting and self.waiting[0][0] <= now:
            released += 1
            if released > FEW:
                self._timeline.spend(1)
            entry = self.waiting.popleft()
            self.waits.discard(entry[1])
            if self._timeline.journal is not None:
                self._timeline.journal.append(Undo(self._wait_again, entry))
            self._hold(entry[1], entry[0] - self._lower)

    def _wait(self, key: Key) -> None:
        self.waits.add(key)
        self.waiting.append((self._clock.now + self._lower, key))
        if self._timeline.journal is not None:
            self._timeline.journal.append(self._wait_no_more)

    def _wait_again(self, entry: tuple[int, Key]) -> None:
        self.waiting.appendleft(entry)
        self.waits.add(entry[1])

    def _wait_no_more(self) -> None:
        self.waits.discard(self.waiting.pop()[1])

    def _hold(self, key: Key, time: int) -> None:
        self._held.add(key, time)
        self.changes.append(key)


def _deadline(entry: tuple[int, Key]) -> int:
    return entry[0]
