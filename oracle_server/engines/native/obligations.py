"""Obligations, as the last node of an engine: each step at which the trigger holds opens one for each of its values.

Each is decided once, as early as possible, by a step or by time alone. Keys at which something is open are looked at
only where an operand changes, or is not neutral; all others sleep.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from typing import Any

from oracle_server.core.formula.tree import Scalar
from oracle_server.core.lost import Lost
from oracle_server.core.owing import NO_UNANSWERED, AllUnanswered, Unanswered
from oracle_server.core.records import EventRecord
from oracle_server.engines.native.body import NOTHING, weight
from oracle_server.engines.native.eventually import Eventually
from oracle_server.engines.native.joined import Leaf, Pattern, fits
from oracle_server.engines.native.keys import Key, Region, Variables, is_fresh, key_of, read_key, texts_of
from oracle_server.engines.native.resolved import Decided, count, first_failed
from oracle_server.engines.native.timeline import FEW, Timeline
from oracle_server.engines.native.triggers import Triggers
from oracle_server.engines.native.until import Until
from oracle_server.engines.native.waiting import FALSE, LOST, OPEN, Awaited, Moment, Present, never
from oracle_server.engines.native.within import Within


class Obligations:
    """`forall[x]. φ -> ψ`: holds at a step at which none was decided false."""

    slot = 0
    variables: Variables = ()
    flat = True
    binds: frozenset[int] = frozenset()
    multiplies = lasting = False

    def __init__(
        self,
        names: Sequence[str],
        present: Present,
        trigger: Callable[[], Collection[Key]],
        losing: Leaf | None,
        goal: Awaited,
        leaves: Sequence[Leaf],
        waiting: Sequence[Eventually | Until],
    ) -> None:
        """`leaves` are the parts of `goal` that look back, and `waiting` those with deadlines.

        `names` are those of the variables. `trigger` tells the keys at which the present step is one, `losing` is the
        same as a part that can fail.
        """
        self.event: Callable[[], EventRecord] = _no_event
        """Tells the present step's event."""
        self.decided: list[Decided] = []
        """What was decided with the last step, or by the time that came last."""
        self.broken = False
        """Whether some of it is false."""
        self.ended = False
        """Whether nothing will come any more."""
        self.at_step = False
        """Whether a step came last, and not time alone."""
        self.number = 0
        """The present step's."""
        self.pending = 0
        """How many are open."""
        self.passing: int | None = None
        """The time that is being decided; whoever has it decided sets this to None, which ends it."""
        self.changes: list[Key] = []
        self._names, self._present, self._trigger, self._losing = names, present, trigger, losing
        self._goal, self._leaves = goal, leaves
        self._deadlines = [node.deadlines for node in waiting]
        self._weight = weight(len(waiting) + sum(leaf.body.operands for leaf in leaves))
        """What it takes to look at a key."""
        self._timeline: Timeline = present.timeline
        self._keyed = bool(names)
        alone = len(names) == 1 and len(leaves) == 1 and leaves[0].pick is None
        self._plain = leaves[0] if alone else None
        """The only part, where it has the only variable."""
        self._counts: dict[Key, int] = {}
        """How many are open at each key."""
        self._triggers = Triggers(self._timeline)
        self._awake: frozenset[Key] = frozenset()
        """The keys that are looked at with the next step, whether or not an operand changes."""
        self._over = 0
        """How many obligations have run out at the present time."""
        self._triggered = False
        """Whether the last step was a trigger, or may have been one."""
        self._loses = False
        """Whether there is something that can't be judged at the present step."""
        self._within = {id(leaf): Within(leaf.places) for leaf in leaves if leaf.pick and leaf.places}
        """The keys with something open by the values of a part's own variables, where it has some of them only."""
        goal.above, goal.slot = self, 0

    def lose(self, lost: Collection[Lost]) -> None:
        """At the next step these atoms can't be judged, with these values at their refs, None for any."""
        self._loses = bool(lost)
        for leaf in (*self._leaves, *([self._losing] if self._losing else ())):
            leaf.lose(lost)

    def step(self) -> None:  # noqa: C901 -- written out, since each step goes this way
        """Take the present step."""
        present, goal, counts = self._present, self._goal, self._counts
        if self._timeline.journal is not None or self.decided or not self.at_step:
            self._begin(self._timeline.now)
        elif self._timeline.now > present.now:
            present.now = self._timeline.now
        present.moment = (present.now, self.number)
        keys = (self._woken() if self._keyed else _UNKEYED) if counts else ()
        if len(keys) > FEW:
            self._timeline.spend(len(keys) * self._weight)
        triggered = self._keys() if self._loses else self._trigger()
        for key in keys:
            if key not in triggered:
                goal.step(key, False)
        for key in triggered:
            value = goal.step(key, True)
            if value == OPEN:
                self._open(key)
            else:
                self.decided.append(Decided(present.moment, key, value, self.event()))
                self.broken = self.broken or value == FALSE
        for deadlines in self._deadlines:
            if deadlines.queue and deadlines.queue[0][0] < present.now:
                self._over = 0
                self._expire(never)
                break
        if self._keyed:
            self._awake = self._restless(keys, triggered)
        self._triggered = bool(triggered)
        if self._loses:
            self._triggered = self._triggered or (self._losing is not None and bool(self._losing.lost))
            self.lose(())

    def _restless(self, keys: Collection[Key], triggered: Collection[Key]) -> frozenset[Key]:
        """Of the keys that were looked at, those that can't sleep: an operand is not neutral there."""
        counts, is_still = self._counts, self._goal.is_still
        awake = [key for key in keys if key in counts and not is_still(key)]
        awake += [key for key in triggered if key in counts and not is_still(key)]
        return frozenset(awake) if awake else _NONE

    def decide(self, time: int, enough: Callable[[], bool]) -> bool:
        """Time has come without a step: decide of what is over until `enough`; whether nothing of it is left."""
        if self.passing is None:
            self._begin(time)
            self.at_step, self.passing, self._over = False, time, 0
        return self._expire(enough)

    def forget(self) -> None:
        """Tell no more of what was decided before."""
        self.decided, self.broken = [], False

    def end(self) -> None:
        """Nothing will come any more: all that is open is decided."""
        self._begin(self._present.now)
        self.at_step = False
        self.ended = self._present.ended = True
        for key in list(self._counts):
            self._goal.passed(key)
        self._present.ended = False

    def resolved(self, key: Key, slot: int, about: Moment, value: int) -> None:  # noqa: ARG002 -- there is one
        """An obligation is decided."""
        counts, journal = self._counts, self._timeline.journal
        self.decided.append(Decided(about, key, value, self._triggers.close(about[1])))
        if value == FALSE:
            self.broken = True
        self.pending -= 1
        count = counts[key]
        if journal is not None:
            journal.append(partial(counts.__setitem__, key, count))
        if count > 1:
            counts[key] = count - 1
            return
        del counts[key]
        for index in self._within.values():
            index.remove(key)
            self._present.note(partial(index.add, key))

    @property
    def now(self) -> int:
        """The time of the last step, or up to which time has decided something, if that is later."""
        return self._present.now

    @property
    def failed(self) -> list[Decided]:
        """What was decided false with the last step, or by the time that came last, the oldest first; see there."""
        return first_failed(self.decided) if self.broken else []

    @property
    def failures(self) -> int:
        """How many were decided false then."""
        return count(self.decided, FALSE) if self.broken else 0

    def is_over(self, start: Moment, upper: int | None) -> bool:
        """Whether nothing that comes can be within a bound of a step."""
        return self._present.is_over(start, upper)

    @property
    def lost(self) -> int:
        """How many can't be decided any more, as of the last step or the time that came last."""
        return count(self.decided, LOST)

    @property
    def closed(self) -> int:
        """How many were decided with the last step, or by the time that came last."""
        return len(self.decided)

    def unanswered(self) -> AllUnanswered:
        """Those of them that were decided false."""
        if not self.broken:
            return NO_UNANSWERED
        told = [Unanswered(each.event, self.values(each.key)) for each in self.failed]
        now = self._present.moment if self.at_step else None
        return AllUnanswered(told, self.failures, count([each for each in self.decided if each.start == now], FALSE))

    def values(self, key: Key) -> dict[str, Scalar]:
        """The values of the variables at a key."""
        return {name: json.loads(text) for name, text in zip(self._names, texts_of(key), strict=True) if text}

    def at(self, key: Key) -> bool:  # noqa: ARG002 -- it has one value
        """Whether none was decided false with this step."""
        return not self.broken

    def due(self) -> int | None:
        """When this must be stepped even if nothing changes below."""
        if self._awake or self._triggered or self.decided:
            return 0
        if not self._keyed and self._counts and not self._goal.is_still(()):
            return 0
        return min((first + 1 for first in self._firsts()), default=None)

    def next_deadline(self, after: int) -> int | None:
        """The first time later than `after` at which time alone decides something."""
        if self.passing is not None and after < self.passing:
            return self.passing
        found = [later for deadlines in self._deadlines if (later := deadlines.later(after)) is not None]
        return min(found, default=None)

    def snapshot(self) -> Any:
        """The state as plain data."""
        return {
            "now": self._present.now,
            "moment": self._present.moment,
            "open": list(self._counts.items()),
            "opened": self._triggers.snapshot(),
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
        self._triggers.restore(data["opened"])
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

    def _begin(self, now: int) -> None:
        """Time goes on, with a step or without one; what that changes here can be taken back."""
        present = self._present
        journal = self._timeline.journal
        if journal is not None:
            saved = self.decided, self.broken, self.pending, self._awake, self._triggered, self.at_step
            clock = present.now, present.moment, present.opened
            journal.append(partial(self._back, saved, clock))
        if self.decided or journal is not None:
            self.decided, self.broken = [], False
        if not self.at_step:
            self.at_step, self.ended = True, False
        present.now = max(present.now, now)  # a step that comes when time has gone on further opens nothing again

    def _back(self, saved: _Saved, clock: tuple[int, Moment, int]) -> None:
        self.decided, self.broken, self.pending, self._awake, self._triggered, self.at_step = saved
        self._present.now, self._present.moment, self._present.opened = clock

    def _keys(self) -> Collection[Key]:
        """The keys at which the present step is a trigger; not those at which that can't be judged."""
        keys = self._trigger()
        if self._losing is not None and self._losing.lost:
            return [key for key in keys if not any(fits(pattern, key) for pattern in self._losing.lost)]
        return keys

    def _open(self, key: Key) -> None:
        """Something is open about the present step."""
        counts, journal = self._counts, self._timeline.journal
        self._triggers.open(self._present.moment[1], self.event)
        self.pending += 1
        count = counts.get(key, 0)
        counts[key] = count + 1
        if journal is not None:
            journal.append(partial(counts.__setitem__, key, count) if count else partial(counts.pop, key))
        if not count:
            for index in self._within.values():
                index.add(key)
                self._present.note(partial(index.remove, key))

    def _woken(self) -> Collection[Key]:
        """The keys with something open that are to be looked at."""
        counts = self._counts
        if self._plain is not None and not self._awake and not self._loses:
            changed = self._plain.body.touched(NOTHING)
            if None not in changed:
                return [key for key in changed if key in counts]
        found = set(self._awake)
        for leaf in self._leaves:
            for keys in (self._of(leaf), self._matching(leaf.lost)) if leaf.lost else (self._of(leaf),):
                if keys is counts:
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
        if any(not pattern.texts or None in pattern.texts for pattern in patterns):
            return self._counts
        return [key_of(pattern.texts) for pattern in patterns]

    def _expire(self, enough: Callable[[], bool]) -> bool:
        """Decide what is over until `enough`; whether nothing is left. Raises `EngineError` where it is too much."""
        self._timeline.run_out(self._over)
        for deadlines in self._deadlines:
            while (key := deadlines.take()) is not None:
                before = len(self.decided)
                self._goal.passed(key)
                self._over += max(1, len(self.decided) - before)
                self._timeline.run_out(self._over)
                if enough():
                    return False
        return True

    def _firsts(self) -> Iterator[int]:
        return (first for deadlines in self._deadlines if (first := deadlines.first) is not None)


_NONE: frozenset[Key] = frozenset()
_UNKEYED: Collection[Key] = ((),)
_Saved = tuple[list[Decided], bool, int, frozenset[Key], bool, bool]


_NO_EVENT: EventRecord = {"stream": "", "kind": "topic", "stamp": 0, "monitor": "", "seq": 0, "signals": {}}


def _no_event() -> EventRecord:
    return _NO_EVENT


def _moment(data: Sequence[int]) -> Moment:
    return data[0], data[1]
