"""`once[:b]` and `since[:b]` of what can't hold for fresh values: the keys at which it last held recently enough."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Collection, Iterator
from functools import partial
from itertools import chain
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.held import Held
from oracle_server.engines.native.keys import ALL, Key, Region, is_fresh, picker, read_key, texts_of
from oracle_server.engines.native.nodes import Node, texts_at
from oracle_server.engines.native.timeline import FEW, Timeline, Undo


class Latest:
    """Holds at a key while the right side does, and until the left side fails or that is too long ago.

    With no lower bound the last time at which the right side held decides alone.
    """

    __slots__ = (
        "_body",
        "_breaking",
        "_clock",
        "_ended",
        "_held",
        "_leaving",
        "_left",
        "_pick",
        "_right",
        "_timeline",
        "_upper",
        "at",
        "binds",
        "changes",
        "flat",
        "multiplies",
        "variables",
    )  # fmt: skip
    lasting = False

    def __init__(
        self, right: Body, left: Body | None, upper: int | None, timeline: Timeline, clock: Timeline | None = None
    ) -> None:
        """`right` is flat; `left`, where there is one, has no other variables.

        `clock` has the times of the steps, None where these are the timeline's.
        """
        self._body, self._upper, self._timeline, self._clock = right, upper, timeline, clock or timeline
        self.variables = right.variables
        self._right = right.at[0]
        self._left = left
        self._breaking: list[tuple[Node, list[int] | None]] = []
        """The nodes of the left side, each with the places of its variables where it has not all of them."""
        self._pick: Callable[[Key], Key] | None = None
        if left is not None:
            self._pick = picker([self.variables.index(v) for v in left.variables], len(self.variables))
            for node in left.nodes:
                places = [self.variables.index(v) for v in node.variables]
                self._breaking.append((node, None if node.variables == self.variables else places))
        self.flat, self.binds, self.multiplies = True, frozenset(right.variables), right.multiplies
        self.changes: list[Key] = []
        self._held = Held(len(self.variables), timeline, counted=right.multiplies)
        """Where it holds, and since when."""
        self._ended: dict[Key, int] = {}
        """Where it holds although the right side does not any more, and when that last did."""
        self._leaving: deque[tuple[int, Key]] = deque()
        """When what has ended will have been too long ago, and where."""
        self.at = self._held.times.__contains__

    def step(self) -> None:
        """Take what changed below and what time changes."""
        if self.changes:
            self.changes = []
        if self._ended and self._left is not None:
            self._break(self._left)
        keys = self._body.touched(self)
        if keys:
            self._touch(keys)
        if self._leaving and self._leaving[0][0] <= self._clock.now:
            self._expire()

    def due(self) -> int | None:
        """When this must be stepped even if nothing changes below."""
        return self._leaving[0][0] if self._leaving else None

    def next_deadline(self, after: int) -> int | None:
        """The first time later than `after` at which the value may change without a step."""
        if self._upper is None:
            return None
        # what holds at the last step may not hold at the next one, and so end there
        ending = self._clock.now + self._upper + 1
        deadlines = [ending] if ending > after and len(self._ended) < len(self._held.times) else []
        for place in range(bisect_right(self._leaving, after, key=_deadline), len(self._leaving)):
            if self._last(*self._leaving[place]):
                deadlines.append(self._leaving[place][0])
                break
        return min(deadlines, default=None)

    def points(self) -> Collection[Key]:
        """The keys at which it holds."""
        return self._held.times

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of the keys in a region."""
        return self._held.spread(region, place)

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        return self._held.constant(region)

    def when(self, key: Key) -> int | None:
        """The time of a step that makes it hold at a key; None where it does not."""
        return self._ended.get(key, self._clock.now) if key in self._held.times else None

    def snapshot(self) -> Any:
        """The state as plain data."""
        return [list(self._held.times.items()), list(self._ended.items()), list(self._leaving)]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        held, ended, leaving = data
        for key, time in held:
            self._held.add(read_key(key), time)
        self._ended.update((read_key(key), time) for key, time in ended)
        self._leaving.extend((deadline, read_key(key)) for deadline, key in leaving)

    def apart(self, variable: int) -> Iterator[str]:
        """The texts at which it holds, and those that are distinguished below."""
        left = () if self._left is None else self._left.apart(variable)
        return chain(texts_at(self._held.times, self.variables, variable), self._body.apart(variable), left)

    def settled(self, key: Key) -> bool | None:
        """The value at a key, where no continuation can change it; None where one may."""
        right = self._body.settled[0](key)
        if right is True:
            return True
        left = True if self._left is None else self._left.settled[0](self._of_left(key))
        if key in self._held.times:
            return True if left is True and self._upper is None else None
        return False if right is False else None

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        right = self._body.can_settle[0](fresh)
        left = (True, False) if self._left is None else self._left.can_settle[0](fresh)
        return right[0] or (left[0] and self._upper is None and fresh.isdisjoint(self.variables)), right[1]

    def index(self) -> None:
        """Prepare for `spread`."""
        self._held.index()

    def _touch(self, keys: Collection[Key]) -> None:
        right, left, held, ended = self._right, self._left, self._held.times, self._ended
        for key in keys:
            if right(key):
                if key not in held:
                    self._held.add(key, self._clock.now)
                    self.changes.append(key)
                elif key in ended:
                    self._forget(key)
            elif key in held and key not in ended:
                if left is None or left.at[0](self._of_left(key)):
                    self._end(key)
                else:
                    self._drop(key)

    def _break(self, left: Body) -> None:
        """Let go of what has ended, where the left side fails now."""
        if not left.variables and left.at[0](()):
            return
        keys = self._concerned()
        if len(keys) > FEW:
            self._timeline.spend(len(keys))
        for key in list(keys):
            if key in self._ended and not left.at[0](self._of_left(key)):
                self._forget(key)
                self._drop(key)

    def _concerned(self) -> Collection[Key]:
        """The keys for which the left side may have changed with this step."""
        found: list[Key] = []
        for node, places in self._breaking:
            for key in node.changes:
                if places is None and not is_fresh(key):
                    found.append(key)
                    continue
                region: list[Any] = [ALL] * len(self.variables)
                for place, text in zip(places or range(len(region)), texts_of(key), strict=False):
                    region[place] = ALL if text is None else text
                if region.count(ALL) == len(region):
                    return self._ended
                found += self._held.within(region)
        return found

    def _of_left(self, key: Key) -> Key:
        return key if self._pick is None else self._pick(key)

    def _expire(self) -> None:
        now, left = self._clock.now, 0
        while self._leaving and self._leaving[0][0] <= now:
            left += 1
            if left > FEW:
                self._timeline.spend(1)
            entry = self._leaving.popleft()
            if self._timeline.journal is not None:
                self._timeline.journal.append(Undo(self._leaving.appendleft, entry))
            if self._last(*entry):
                self._forget(entry[1])
                self._drop(entry[1])

    def _last(self, deadline: int, key: Key) -> bool:
        """Whether what leaves at a deadline is what last ended at a key."""
        return self._ended.get(key) == deadline - (self._upper or 0) - 1

    def _end(self, key: Key) -> None:
        """Note that the right side held with the step before for the last time."""
        before = self._clock.before
        self._ended[key] = before
        if self._timeline.journal is not None:
            self._timeline.journal.append(Undo(self._ended.pop, key))
        if self._upper is not None:
            self._leaving.append((before + self._upper + 1, key))
            if self._timeline.journal is not None:
                self._timeline.journal.append(self._leaving.pop)

    def _forget(self, key: Key) -> None:
        """Record that what ended does not count any more."""
        time = self._ended.pop(key)
        if self._timeline.journal is not None:
            self._timeline.journal.append(partial(self._ended.__setitem__, key, time))

    def _drop(self, key: Key) -> None:
        self._held.remove(key)
        self.changes.append(key)


def _deadline(entry: tuple[int, Key]) -> int:
    return entry[0]
