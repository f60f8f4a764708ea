"""Obligations, as the last node of an engine: each step at which the trigger holds opens one for each of its values.

Each is decided once, as early as possible, by a step or by time alone. Keys at which something is open are looked at
only where an operand changes, or is not neutral; all others sleep.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

from oracle_server.core.formula.tree import Scalar
from oracle_server.core.owing import Unanswered
from oracle_server.core.records import EventRecord
from oracle_server.engines.native.eventually import Eventually
from oracle_server.engines.native.guarded import SomeGuarded
from oracle_server.engines.native.joined import Leaf, Pattern, fits
from oracle_server.engines.native.keys import Key, Region, Variables, is_fresh, key_of, read_key, texts_of
from oracle_server.engines.native.some import Some
from oracle_server.engines.native.timeline import FEW, Timeline
from oracle_server.engines.native.until import Until
from oracle_server.engines.native.waiting import FALSE, LOST, OPEN, Awaited, Moment, Present


class Decided(NamedTuple):
    """An obligation that was decided: the step that triggered it, for which values, what came of it, and its event.

    `value` is `TRUE`, `FALSE` or `LOST`.
    """

    start: Moment
    key: Key
    value: int
    event: EventRecord


class Opened:
    """The event of a step of which some obligations are open, and how many."""

    __slots__ = ("count", "event")

    def __init__(self, event: EventRecord, count: int = 0) -> None:
        self.event, self.count = event, count


class Obligations:
    """`forall[x]. φ -> ψ`: holds at a step at which none was decided false."""

    slot = 0
    variables: Variables = ()
    flat = True

    def __init__(
        self,
        names: Sequence[str],
        present: Present,
        trigger: Some | SomeGuarded | Callable[[], bool] | None,
        losing: Leaf | None,
        goal: Awaited,
        leaves: Sequence[Leaf],
        waiting: Sequence[Eventually | Until],
    ) -> None:
        """`leaves` are the parts of `goal` that look back, and `waiting` those with deadlines.

        `names` are those of the variables. `trigger` tells its keys, or whether it holds where there are no variables;
        None: each step is one. `losing` is the same as a part that can fail.
        """
        self.event: Callable[[], EventRecord] = _no_event
        """Tells the present step's event."""
        self.decided: list[Decided] = []
        """What was decided with the last step, or the time that came last."""
        self.ended = False
        """Whether nothing will come any more."""
        self.at_step = False
        """Whether a step came last, and not time alone."""
        self.number = 0
        """The present step's."""
        self.pending = 0
        """How many are open."""
        self.changes: list[Key] = []
        self._names, self._present, self._trigger, self._losing = names, present, trigger, losing
        self._goal, self._leaves, self._waiting = goal, leaves, waiting
        self._timeline: Timeline = present.timeline
        self._counts: dict[Key, int] = {}
        """How many are open at each key."""
        self._opened: dict[int, Opened] = {}
        """By number, the steps that opened them."""
        self._awake: frozenset[Key] = frozenset()
        """The keys that are looked at with the next step, whether or not an operand changes."""
        self._triggered = False
        """Whether the last step was a trigger, or may have been one."""
        self._loses = False
        """Whether there is something that can't be judged at the present step."""
        self._within = {id(leaf): _Within(leaf.places) for leaf in leaves if leaf.pick and leaf.places}
        """The keys with something open by the values of a part's own variables, where it has some of them only."""
        goal.above, goal.slot = self, 0

    def lose(self, lost: Collection[tuple[int, Pattern]]) -> None:
        """At the next step these atoms can't be judged, with these values at their refs, None for any."""
        self._loses = bool(lost)
        for leaf in (*self._leaves, *([self._losing] if self._losing else ())):
            leaf.lose(lost)

    def step(self) -> None:
        """Take the present step."""
        present, timeline = self._present, self._timeline
        self._begin(timeline.now, at_step=True)
        present.moment = (present.now, self.number)
        keys = self._woken() if self._counts else ()
        triggered = self._keys()
        goal, looked = self._goal, [*triggered]
        for key in keys:
            if key not in triggered:
                looked.append(key)
                goal.step(key, False)
        for key in triggered:
            self._open(key)
            value = goal.step(key, True)
            if value != OPEN:
                self.resolved(key, 0, present.moment, value)
        self._expire()
        counts = self._counts
        self._awake = (
            frozenset([key for key in looked if key in counts and not goal.is_still(key)]) if looked else _NONE
        )
        self._triggered = bool(triggered)
        if self._loses:
            self._triggered = self._triggered or (self._losing is not None and bool(self._losing.lost))
            self.lose(())

    def pass_time(self, time: int) -> None:
        """Time has come without a step: what is over is decided."""
        self._begin(time, at_step=False)
        self._expire()

    def end(self) -> None:
        """Nothing will come any more: all that is open is decided."""
        self._begin(self._present.now, at_step=False)
        self.ended = self._present.ended = True
        for key in list(self._counts):
            self._goal.passed(key)
        self._present.ended = False

    def resolved(self, key: Key, slot: int, about: Moment, value: int) -> None:  # noqa: ARG002 -- there is one
        """An obligation is decided."""
        present, number = self._present, about[1]
        opened = self._opened[number]
        self.decided.append(Decided(about, key, value, opened.event))
        self.pending -= 1
        if opened.count == 1:
            present.pop(self._opened, number)
        else:
            present.note(partial(setattr, opened, "count", opened.count))
            opened.count -= 1
        left = self._counts[key] - 1
        if left:
            present.put(self._counts, key, left)
            return
        present.pop(self._counts, key)
        for index in self._within.values():
            index.remove(key)
            present.note(partial(index.add, key))

    @property
    def failed(self) -> list[Decided]:
        """What was decided false with the last step, or by the time that came last, the oldest first."""
        return sorted([each for each in self.decided if each.value == FALSE]) if self.decided else []

    @property
    def lost(self) -> int:
        """How many can't be decided any more, as of the last step or the time that came last."""
        return sum(each.value == LOST for each in self.decided)

    @property
    def closed(self) -> int:
        """How many were decided with the last step, or by the time that came last."""
        return len(self.decided)

    def unanswered(self) -> Sequence[Unanswered]:
        """Those of them that were decided false, the oldest first."""
        return [Unanswered(each.event, self.values(each.key)) for each in self.failed] if self.decided else ()

    def values(self, key: Key) -> dict[str, Scalar]:
        """The values of the variables at a key."""
        return {name: json.loads(text) for name, text in zip(self._names, texts_of(key), strict=True) if text}

    def at(self, key: Key) -> bool:  # noqa: ARG002 -- it has one value
        """Whether none was decided false with this step."""
        return all(each.value != FALSE for each in self.decided)

    def due(self) -> int | None:
        """When this must be stepped even if nothing changes below."""
        if self._awake or self._triggered or self.decided:
            return 0
        return min((first + 1 for first in self._firsts()), default=None)

    def next_deadline(self, after: int) -> int | None:
        """The first time later than `after` at which time alone decides something."""
        first = min(self._firsts(), default=None)
        return None if first is None else max(first, after) + 1

    def snapshot(self) -> Any:
        """The state as plain data."""
        opened = [(number, found.event, found.count) for number, found in self._opened.items()]
        return {
            "now": self._present.now,
            "moment": self._present.moment,
            "open": list(self._counts.items()),
            "opened": opened,
            "steps": self._present.opened,
            "awake": list(self._awake),
            "triggered": self._triggered,
            "goal": self._goal.snapshot(),
        }

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self._present.now, self._present.opened = data["now"], data["steps"]
        self._present.moment = _moment(data["moment"])
        self._counts = {read_key(key): count for key, count in data["open"]}
        self._opened = {number: Opened(event, count) for number, event, count in data["opened"]}
        self._awake = frozenset(read_key(key) for key in data["awake"])
        self._triggered = data["triggered"]
        self.pending = sum(self._counts.values())
        for index in self._within.values():
            for key in self._counts:
                index.add(key)
        self._goal.restore(data["goal"])

    def points(self) -> Collection[Key]:
        """None: it has one value."""
        return ()

    def spread(self, region: Region, place: int) -> Collection[str]:  # noqa: ARG002 -- as at every node
        """None: it has one value."""
        return ()

    def constant(self, region: Region) -> bool | None:  # noqa: ARG002
        """The value."""
        return self.at(())

    def index(self) -> None:
        """Nothing to prepare."""

    def apart(self, variable: int) -> Iterator[str]:  # noqa: ARG002
        """None: it has one value."""
        return iter(())

    def settled(self, key: Key) -> None:
        """None: what comes may always open another one."""

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:  # noqa: ARG002
        """Neither."""
        return False, False

    def _begin(self, now: int, *, at_step: bool) -> None:
        """Time goes on, with a step or without one; what that changes here can be taken back."""
        present = self._present
        if self._timeline.journal is not None:
            saved = (self.decided, self.pending, self._awake, self._triggered, self.at_step)
            clock = (present.now, present.moment, present.opened)
            self._timeline.journal.append(partial(self._back, saved, clock))
        self.decided, self.at_step, self.ended = [], at_step, False
        present.now = max(present.now, now)  # a step that comes when time has gone on further opens nothing again

    def _back(
        self, saved: tuple[list[Decided], int, frozenset[Key], bool, bool], clock: tuple[int, Moment, int]
    ) -> None:
        self.decided, self.pending, self._awake, self._triggered, self.at_step = saved
        self._present.now, self._present.moment, self._present.opened = clock

    def _keys(self) -> Collection[Key]:
        """The keys at which the present step is a trigger; not those at which that can't be judged."""
        keys = self._candidates()
        if keys and self._losing is not None and self._losing.lost:
            return [key for key in keys if not any(fits(pattern, key) for pattern in self._losing.lost)]
        return keys

    def _candidates(self) -> Collection[Key]:
        trigger = self._trigger
        if trigger is None:
            return _UNKEYED
        if isinstance(trigger, Some | SomeGuarded):
            return trigger.keys(())
        return _UNKEYED if trigger() else ()

    def _open(self, key: Key) -> None:
        present, number = self._present, self._present.moment[1]
        opened = self._opened.get(number)
        if opened is None:
            opened = Opened(self.event())
            present.put(self._opened, number, opened)
        opened.count += 1
        self.pending += 1
        count = self._counts.get(key, 0)
        present.put(self._counts, key, count + 1)
        if not count:
            for index in self._within.values():
                index.add(key)
                present.note(partial(index.remove, key))

    def _woken(self) -> Collection[Key]:
        """The keys with something open that are to be looked at."""
        counts, found = self._counts, set(self._awake)
        for leaf in self._leaves:
            for keys in (self._of(leaf), self._matching(leaf.lost)) if leaf.lost else (self._of(leaf),):
                if keys is counts:
                    self._timeline.spend(len(counts) // FEW)
                    return list(counts)
                found.update(keys)
        return [key for key in found if key in counts]

    def _of(self, leaf: Leaf) -> Collection[Key]:
        """The keys at which a part may have changed with this step; all that are open where it may be any."""
        changed = leaf.changed()
        if not changed:
            return ()
        if leaf.pick is None:
            return self._counts if any(map(is_fresh, changed)) else changed
        if not leaf.places or any(map(is_fresh, changed)):
            return self._counts
        index = self._within[id(leaf)]
        return [key for part in changed for key in index.keys(part)]

    def _matching(self, patterns: Sequence[Pattern]) -> Collection[Key]:
        """The keys that patterns stand for: all that are open where one stands for many."""
        if any(not pattern or None in pattern for pattern in patterns):
            return self._counts
        return [key_of(pattern) for pattern in patterns]

    def _expire(self) -> None:
        """Decide what is over, and skip deadlines of what was decided before."""
        for node in self._waiting:
            first = node.deadlines.first
            if first is not None and first < self._present.now:
                for key in node.deadlines.take():
                    self._goal.passed(key)
        for node in self._waiting:
            if node.deadlines.queue:
                node.deadlines.drop(node.rows)

    def _firsts(self) -> Iterator[int]:
        return (first for node in self._waiting if (first := node.deadlines.first) is not None)


class _Within:
    """Keys by the values at some of their places."""

    def __init__(self, places: Sequence[int]) -> None:
        self._places = places
        self._by: dict[Key, dict[Key, None]] = {}

    def add(self, key: Key) -> None:
        """Take in a key."""
        self._by.setdefault(self._part(key), {})[key] = None

    def remove(self, key: Key) -> None:
        """Forget a key."""
        part = self._part(key)
        del self._by[part][key]
        if not self._by[part]:
            del self._by[part]

    def keys(self, part: Key) -> Collection[Key]:
        """The keys with these values."""
        return self._by.get(part, ())

    def _part(self, key: Key) -> Key:
        texts = texts_of(key)
        return key_of([texts[place] for place in self._places])


_NONE: frozenset[Key] = frozenset()
_UNKEYED: Collection[Key] = ((),)


def _no_event() -> EventRecord:
    return {"stream": "", "kind": "topic", "stamp": 0, "monitor": "", "seq": 0, "signals": {}}


def _moment(data: Sequence[int]) -> Moment:
    return data[0], data[1]
