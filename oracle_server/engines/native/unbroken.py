"""`left since[:b] right` where the left side has variables that the right one has not, and fails at few values.

It holds where the right side held last when the left one had failed last, or later. Both are kept for their own
variables alone: where one is told apart for all values of another, there would be as many keys as combinations.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Collection, Iterator
from functools import partial
from itertools import chain
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.keys import ALL, Key, Region, key_of, read_key
from oracle_server.engines.native.standing import Places, Standing, merged
from oracle_server.engines.native.timeline import FEW, Timeline, Undo

Leaving = tuple[int, int, Key]
"""When what ended will have been too long ago, the last turn at which it held, and where."""


class Unbroken:
    """Knows where the right side held last, and where the left one failed last, in turns; see `Standing`."""

    flat = lasting = False
    multiplies = True

    def __init__(self, right: Body, broken: Body, upper: int | None, timeline: Timeline) -> None:
        """`broken` is the left side's negation. Both are flat, and hold for no fresh values."""
        self._right, self._broken = Standing(right, timeline), Standing(broken, timeline)
        self._upper, self._timeline = upper, timeline
        self.variables = tuple(sorted({*right.variables, *broken.variables}))
        self.binds = frozenset(right.variables)
        self._of_right = Places(right.variables, self.variables)
        self._of_broken = Places(broken.variables, self.variables)
        self.changes: list[Key] = []
        self._leaving: deque[Leaving] = deque()
        self._mended: deque[tuple[int, Key]] = deque()
        """With a bound: the last turn at which the left side failed, and where, in order."""
        self._turn = 0

    def step(self) -> None:
        """Take what changed below and what time changes."""
        if self.changes:
            self.changes = []
        right, broken = self._right.turning(), self._broken.turning()
        if right or broken:
            self._note(partial(setattr, self, "_turn", self._turn))
            self._turn += 1
            self._take(right, broken)
        if self._upper is not None:
            self._expire(self._upper)
            self._forget()

    def _take(self, right: list[Key], broken: list[Key]) -> None:
        """Take in where the sides turned."""
        ended = [key for key in right if key in self._right.holds]
        for key in broken:
            if key not in self._broken.holds:
                self.changes.append(self._of_broken.whole(key))
            elif self._upper is not None:
                self._mended.append((self._turn - 1, key))
                self._note(self._mended.pop)
            self._broken.turn(key, self._turn)
        for key in right:
            self._right.turn(key, self._turn)
        self.changes += [self._of_right.whole(key) for key in right if key in self._right.holds]
        if len(ended) * len(self._broken.holds) > FEW:
            self._timeline.spend(len(ended) * len(self._broken.holds))
        for key in ended:
            whole = self._of_right.whole(key)
            both = (merged(whole, self._of_broken.whole(other)) for other in self._broken.holds)
            self.changes += [each for each in both if each is not None]
            if self._upper is not None:
                self._leaving.append((self._timeline.before + self._upper + 1, self._turn - 1, key))
                self._note(self._leaving.pop)

    def _expire(self, upper: int) -> None:
        """Let go of what ended too long ago."""
        expired = 0
        while self._leaving and self._leaving[0][0] <= self._timeline.now:
            expired += 1
            if expired > FEW:
                self._timeline.spend(1)
            entry = self._leaving.popleft()
            self._note(Undo(self._leaving.appendleft, entry))
            if self._is_last(entry, upper):
                self._right.forget(entry[2])
                self.changes.append(self._of_right.whole(entry[2]))

    def _is_last(self, entry: Leaving, upper: int) -> bool:
        """Whether what leaves is what last held at its key."""
        deadline, turn, key = entry
        return key not in self._right.holds and self._right.last.get(key) == (turn, deadline - upper - 1)

    def _forget(self) -> None:
        """Let go of failures of the left side before which the right side did not hold, as far as it still counts."""
        oldest = self._leaving[0][1] if self._leaving else self._turn
        while self._mended and self._mended[0][0] <= oldest:
            entry = self._mended.popleft()
            self._note(Undo(self._mended.appendleft, entry))
            turn, key = entry
            if key not in self._broken.holds and self._broken.last.get(key, (None,))[0] == turn:
                self._broken.forget(key)

    def at(self, key: Key) -> bool:
        """The value at a key."""
        held = self._right.turn_of(self._of_right.of(key), self._turn)
        if held is None:
            return False
        failed = self._broken.turn_of(self._of_broken.of(key), self._turn)
        return failed is None or held >= failed

    def when(self, key: Key) -> int | None:
        """The time of a step that makes it hold at a key; None where it does not."""
        return self._right.time_of(self._of_right.of(key)) if self.at(key) else None

    def due(self) -> int | None:
        """When this must be stepped even if nothing changes below."""
        return self._leaving[0][0] if self._leaving else None

    def next_deadline(self, after: int) -> int | None:
        """The first time later than `after` at which the value may change without a step."""
        if self._upper is None:
            return None
        # what holds at the last step may not hold at the next one, and so end there
        ending = self._timeline.now + self._upper + 1
        deadlines = [ending] if ending > after and self._right.holds else []
        for place in range(bisect_right(self._leaving, after, key=_deadline), len(self._leaving)):
            if self._is_last(self._leaving[place], self._upper):
                deadlines.append(self._leaving[place][0])
                break
        return min(deadlines, default=None)

    def points(self) -> Collection[Key]:
        """Where the right side held: it is not flat, and there is no list of its keys."""
        return self._right.last

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts that distinguish values at a place of a region."""
        side, places = (
            (self._right, self._of_right) if place in self._of_right.places else (self._broken, self._of_broken)
        )
        return side.spread(places.region(region), places.places.index(place))

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        if ALL not in region:
            return self.at(key_of(region))
        right = self._of_right.region(region)
        return None if self._right.last and (ALL in right or key_of(right) in self._right.last) else False

    def snapshot(self) -> Any:
        """The state as plain data."""
        sides = self._right.snapshot(), self._broken.snapshot()
        return [*sides, list(self._leaving), list(self._mended), self._turn]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        right, broken, leaving, mended, self._turn = data
        self._right.restore(right)
        self._broken.restore(broken)
        self._leaving.extend((deadline, turn, read_key(key)) for deadline, turn, key in leaving)
        self._mended.extend((turn, read_key(key)) for turn, key in mended)

    def apart(self, variable: int) -> Iterator[str]:
        """The texts at which a side held or failed, and those that are distinguished below."""
        return chain(self._right.apart(variable), self._broken.apart(variable))

    def settled(self, key: Key) -> bool | None:
        """The value at a key, where no continuation can change it; None where one may."""
        right = self._right.body.settled[0](self._of_right.of(key))
        if right is True:
            return True
        if self.at(key):
            lasts = self._broken.body.settled[0](self._of_broken.of(key)) is False and self._upper is None
            return True if lasts else None
        return False if right is False else None

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        right, broken = self._right.body.can_settle[0](fresh), self._broken.body.can_settle[0](fresh)
        return right[0] or (broken[1] and self._upper is None and fresh.isdisjoint(self.binds)), right[1]

    def index(self) -> None:
        """Nothing to prepare."""

    def _note(self, undo: Callable[[], object]) -> None:
        if self._timeline.journal is not None:
            self._timeline.journal.append(undo)


def _deadline(entry: Leaving) -> int:
    return entry[0]
