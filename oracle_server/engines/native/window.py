"""`once` and `since` with any bound.

For each key: the runs of steps at which the right side held, as far as they can still count, and deadlines at which a
run comes into the window or leaves it. With no lower bound the last run decides, with no upper bound the first one;
only with both are all runs in the window kept.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Collection, Iterator
from functools import partial
from itertools import chain
from typing import Any

from oracle_server.core.formula.tree import Bound
from oracle_server.engines.native.body import Body
from oracle_server.engines.native.keys import ALL, Key, Region, is_fresh, key_of, read_key
from oracle_server.engines.native.nodes import texts_at
from oracle_server.engines.native.runs import Runs
from oracle_server.engines.native.tables import table
from oracle_server.engines.native.timeline import FEW, Timeline, Undo


class Window:
    """`left since[a:b] right`, or `once[a:b] right` where there is no left side."""

    def __init__(self, body: Body, bound: Bound, timeline: Timeline, clock: Timeline | None = None) -> None:
        """`body` has the right side, and the left one after it where there is one.

        `clock` has the times of the steps, None where these are the timeline's.
        """
        self._body, self._timeline, self._clock = body, timeline, clock or timeline
        self._lower, self._upper = bound.lower, bound.upper
        self._right = body.at[0]
        self._left = body.at[1] if len(body.at) > 1 else None
        self.variables, self.flat = body.variables, body.flat
        self.binds, self.multiplies = body.binds if body.flat else frozenset(), body.multiplies
        self.lasting = self._left is None and bound.upper is None
        self.changes: list[Key] = []
        self._all = bound.lower > 0 and bound.upper is not None
        fresh = Runs()
        if self._all:
            fresh.starts, fresh.ends = deque(), deque()
        self._table = table(len(self.variables), fresh, Runs.copy, timeline, flat=self.flat)
        self._entering: deque[tuple[int, Key]] = deque()
        self._leaving: deque[tuple[int, Key]] = deque()
        self._new_entering: list[tuple[int, Key]] = []
        self._new_leaving: list[tuple[int, Key]] = []
        self._sparse = self._all and timeline.timed
        """Whether the window may hold no step at all."""
        self._peopled = True
        if self._sparse and bound.upper is not None:
            self._clock.keep(bound.upper)

    def at(self, key: Key) -> bool:
        """The value at a key."""
        return self._table.get(key).value

    def step(self) -> None:
        """Take what changed below and what time changes."""
        if self.changes:
            self.changes = []
        if not self.variables:
            self._step_alone()
            return
        keys = self._body.touched(self._table)
        peopled = self._peopled
        if self._sparse and self._upper is not None:
            self._look_for_steps(self._upper)
        if keys:
            self._touch(keys)
        if self._peopled is not peopled:
            self._renew(self._table.keys())
        self._pop(self._entering)
        self._pop(self._leaving)

    def _step_alone(self) -> None:
        """What `step` does, where there is one key only."""
        runs, clock = self._table.fresh, self._clock
        journal, before = self._timeline.journal, runs.values
        if self._sparse and self._upper is not None:
            self._look_for_steps(self._upper)
        right, left = self._right(()), self._left is None or self._left(())
        if right is not runs.right or left is not runs.left or not left:
            if self._move((), runs, left, right) and self._upper is not None:
                self._new_leaving.append((clock.before + self._upper + 1, ()))
            self._queue_new()
        for queue in (self._entering, self._leaving):
            while queue and queue[0][0] <= clock.now:
                entry = queue.popleft()
                if journal is not None:
                    journal.append(Undo(queue.appendleft, entry))
        value = self._value(runs)
        if value is not runs.value:
            runs.value = value
            self.changes.append(())
        if journal is not None and runs.values != before:
            journal.append(Undo(runs.put, before))

    def _look_for_steps(self, upper: int) -> None:
        peopled, journal = self._clock.any_between(self._lower, upper), self._timeline.journal
        if peopled is not self._peopled:
            if journal is not None:
                journal.append(partial(setattr, self, "_peopled", not peopled))
            self._peopled = peopled

    def due(self) -> int | None:
        """When this must be stepped even if nothing changes below."""
        if self._sparse:
            return 0
        queues = [queue[0][0] for queue in (self._entering, self._leaving) if queue]
        return min(queues, default=None)

    def next_deadline(self, after: int) -> int | None:
        """The first time later than `after` at which the value may change without a step."""
        while self._leaving and not self._all and self._stale(*self._leaving[0]):
            entry = self._leaving.popleft()
            if self._timeline.journal is not None:
                self._timeline.journal.append(Undo(self._leaving.appendleft, entry))
        # what holds at the last step may not hold at the next one, so that a run ends, or begins to count, there
        deadlines = [self._clock.now + d for d in (self._lower, None if self._upper is None else self._upper + 1) if d]
        deadlines = [deadline for deadline in deadlines if deadline > after]
        for queue in (self._entering, self._leaving):
            place = bisect_right(queue, after, key=_deadline)
            if place < len(queue):
                deadlines.append(queue[place][0])
        if self._sparse and self._upper is not None:
            turn = self._clock.next_change(self._lower, self._upper, after)
            if turn is not None:
                deadlines.append(turn)
        return min(deadlines, default=None)

    def _stale(self, deadline: int, key: Key) -> bool:
        """Whether a run that leaves the window was followed by another one that is still in it."""
        runs, upper = self._table.known(key), self._upper or 0
        return (
            runs is None or len(runs.starts) > len(runs.ends) or bool(runs.ends and runs.ends[-1] + upper >= deadline)
        )

    def points(self) -> Collection[Key]:
        """The keys that are distinguished."""
        return self._table.points()

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts that are distinguished at a place of a region."""
        return self._table.spread(region, place)

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        if ALL not in region:
            return self.at(key_of(region))
        return self._table.fresh.value if len(self._table.states) <= (not self.flat) else None

    def when(self, key: Key) -> int | None:  # noqa: PLR0911 -- a case a kind of bound
        """The time of a step that makes it hold at a key; None where it does not."""
        runs, clock = self._table.get(key), self._clock
        if not runs.value:
            return None
        if not runs.starts:
            return clock.now  # the left side fails now, and the right one holds
        nearest = clock.now - self._lower
        if self._upper is None:
            return runs.starts[0]
        if not runs.ends or (not self._lower and runs.right):
            return clock.latest(nearest) if self._sparse else nearest
        if not self._lower:
            return runs.ends[-1]
        if runs.ends[0] <= nearest:
            return runs.ends[0]
        return clock.latest(nearest) if self._sparse else nearest

    def snapshot(self) -> Any:
        """The state as plain data."""
        states = [(key, runs.data()) for key, runs in self._table.items()]
        return [states, list(self._entering), list(self._leaving), self._peopled]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        states, entering, leaving, self._peopled = data
        queue = deque[int] if self._all else list[int]
        self._table.load([(read_key(key), Runs.of(runs, queue)) for key, runs in states])
        self._entering.extend((deadline, read_key(key)) for deadline, key in entering)
        self._leaving.extend((deadline, read_key(key)) for deadline, key in leaving)

    def apart(self, variable: int) -> Iterator[str]:
        """The texts that are distinguished here or below."""
        return chain(texts_at(self._table.points(), self.variables, variable), self._body.apart(variable))

    def settled(self, key: Key) -> bool | None:
        """The value at a key, where no continuation can change it; None where one may."""
        right = self._body.settled[0](key)
        left = True if self._left is None else self._body.settled[1](key)
        if right is True and not self._lower:
            return True
        runs = self._table.get(key)
        if left is True and self._upper is None and runs.value:
            return True
        if right is False and not runs.starts:
            return False
        if right is True and left is True and self._all and not self._sparse and len(runs.starts) > len(runs.ends):
            return True if runs.starts[-1] <= self._clock.now - self._lower else None
        return False if left is False and (right is False or self._lower) else None

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        right = self._body.can_settle[0](fresh)
        left = (True, False) if self._left is None else self._body.can_settle[1](fresh)
        lasting = right[0] and left[0] and not self._sparse
        return (right[0] and not self._lower) or (left[0] and self._upper is None) or lasting, right[1] or left[1]

    def index(self) -> None:
        """Prepare for `spread`."""
        self._table.index()

    def _touch(self, keys: Collection[Key]) -> None:
        beneath: dict[Key, None] = {}
        for key in keys:
            runs = self._table.own(key)
            if self._timeline.journal is not None:
                self._timeline.journal.append(Undo(runs.put, runs.values))
            left = self._left is None or self._left(key)
            closed = self._move(key, runs, left, self._right(key))
            self._refresh(key, runs)
            other = self._table.fresh
            if self._upper is not None and (closed or (runs.left is other.left and runs.right is other.right)):
                self._new_leaving.append((self._clock.before + self._upper + 1, key))
        for key in keys:
            if is_fresh(key) and key not in beneath:
                beneath.update(dict.fromkeys(self._table.beneath(key)))
        if beneath:
            self._renew(beneath)
        for key in keys:
            if key not in beneath:
                self._table.drop(key, self._same)
        self._queue_new()

    def _queue_new(self) -> None:
        for queue, new in ((self._entering, self._new_entering), (self._leaving, self._new_leaving)):
            if new:
                new.sort(key=_deadline)
                queue.extend(new)
                if self._timeline.journal is not None:
                    self._timeline.journal.append(queue.pop if len(new) == 1 else partial(_shorten, queue, len(new)))
                new.clear()

    def _move(self, key: Key, runs: Runs, left: bool, right: bool) -> bool:
        """Take the sides' values at this step; whether a run was closed."""
        held, closed = runs.right, False
        if not left:  # a run that counts begins where the left side fails for the last time
            runs.clear(self._timeline.journal)
        elif not runs.left:
            if held:
                self._open(key, runs, self._clock.before)
                closed = not right
            elif right:
                self._open(key, runs, self._clock.now)
        elif right and not held:
            self._open(key, runs, self._clock.now)
        elif held and not right:
            closed = True
        if closed:
            self._close(runs)
        runs.left, runs.right = left, right
        return closed

    def _open(self, key: Key, runs: Runs, start: int) -> None:
        if self._upper is None:
            if runs.starts:
                return
        elif not self._lower:
            runs.clear(self._timeline.journal)
        runs.begin(start, self._timeline.journal)
        if self._lower:
            self._new_entering.append((start + self._lower, key))

    def _close(self, runs: Runs) -> None:
        if self._upper is not None:
            runs.end(self._clock.before, self._timeline.journal)

    def _refresh(self, key: Key, runs: Runs) -> None:
        value = self._value(runs)
        if value is not runs.value:
            if self._timeline.journal is not None:
                self._timeline.journal.append(partial(setattr, runs, "value", runs.value))
            runs.value = value
            self.changes.append(key)

    def _value(self, runs: Runs) -> bool:
        if not runs.left:
            return runs.right and not self._lower
        farthest = None if self._upper is None else self._clock.now - self._upper
        if farthest is not None:
            while runs.ends and runs.ends[0] < farthest:
                runs.forget(self._timeline.journal)
        nearest = self._clock.now - self._lower
        if not runs.starts or runs.starts[0] > nearest:
            return False
        if not self._sparse or self._peopled or farthest is None:
            return True
        return runs.starts[0] >= farthest or bool(runs.ends and runs.ends[0] <= nearest)

    def _same(self, runs: Runs, other: Runs) -> bool:
        """Whether two keys stay equal from now on for as long as their sides are equal."""
        if runs.left is not other.left or runs.right is not other.right or len(runs.starts) != len(other.starts):
            return False
        # before here, when a run began makes no difference any more
        past = self._clock.now - (self._lower if self._upper is None else self._upper)
        begun = zip(runs.starts, other.starts, strict=True)
        return all(p == q or max(p, q) <= past for p, q in begun) and list(runs.ends) == list(other.ends)

    def _renew(self, keys: Collection[Key]) -> None:
        """Look at the values of keys that are distinguished, and which of them still must be; fresh ones come first."""
        self._timeline.spend(len(keys))
        for key in keys:
            runs = self._table.known(key)
            if runs is not None:
                self._refresh(key, runs)
        for key in keys:
            self._table.drop(key, self._same)

    def _pop(self, queue: deque[tuple[int, Key]]) -> None:
        now, popped = self._clock.now, 0
        while queue and queue[0][0] <= now:
            popped += 1
            if popped > FEW:
                self._timeline.spend(1)
            entry = queue.popleft()
            key = entry[1]
            if self._timeline.journal is not None:
                self._timeline.journal.append(Undo(queue.appendleft, entry))
            if is_fresh(key):
                self._renew(self._table.beneath(key))
                continue
            runs = self._table.known(key)
            if runs is not None:
                self._refresh(key, runs)
                self._table.drop(key, self._same)


def _shorten(queue: deque[tuple[int, Key]], count: int) -> None:
    for _ in range(count):
        queue.pop()


def _deadline(entry: tuple[int, Key]) -> int:
    return entry[0]
