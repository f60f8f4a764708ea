"""What the nodes of an obligation have in common: values, the present moment, and changes that can be taken back.

A node is an operator, for all keys: what it waits for at a key is a *row*. The node above asks it about the present
step; it answers at once, or `OPEN`, and then tells its answer later. All changes are noted in the timeline's journal.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Collection, Iterable, Mapping, MutableMapping, MutableSequence, Sequence
from functools import partial
from typing import Any, NoReturn, Protocol, TypeVar

from oracle_server.core.errors import EngineError
from oracle_server.engines.native.keys import Key
from oracle_server.engines.native.timeline import Timeline

FALSE, TRUE, LOST, OPEN = range(4)
"""What is known about a step. `LOST`: it can't be judged any more, since something failed."""
NEGATED = (TRUE, FALSE, LOST, OPEN)
MAX_OPEN = 100_000
"""Steps about which all nodes of a property together may wait: each takes some hundred bytes."""

Moment = tuple[int, int]
"""A step: its time, as the timeline has it, and its number."""
_K = TypeVar("_K")
_V = TypeVar("_V")


def all_of(values: Iterable[int]) -> int:
    """What a conjunction comes to: false where one is, else open where one is, else lost where one is."""
    found = TRUE
    for value in values:
        if value == FALSE:
            return FALSE
        if value == OPEN or (value == LOST and found == TRUE):
            found = value
    return found


def any_of(values: Iterable[int]) -> int:
    """What a disjunction comes to."""
    return NEGATED[all_of([NEGATED[value] for value in values])]


class Present:
    """The present step, or the time that has come without one, and what takes back changes.

    `now` is its time, and `moment` the last step's; `ended`: nothing will come any more.
    """

    __slots__ = ("ended", "moment", "now", "opened", "slack", "timeline")

    def __init__(self, timeline: Timeline) -> None:
        self.timeline = timeline
        self.now, self.moment = 0, (0, 0)
        self.ended = False
        self.opened = 0
        """How many steps all nodes wait about."""
        self.slack = 0 if timeline.timed else -1
        """In time what is exactly so far ahead is awaited; the last of some steps decides when it is judged."""

    def is_over(self, start: Moment, upper: int | None) -> bool:
        """Whether nothing that comes can be within a bound of a step."""
        return self.ended or (upper is not None and self.now > start[0] + upper + self.slack)

    def note(self, undo: Any) -> None:
        """Note what takes a change back."""
        if self.timeline.journal is not None:
            self.timeline.journal.append(undo)

    def insert(self, items: list[Moment], place: int, item: Moment) -> None:
        """Insert into a list."""
        items.insert(place, item)
        if self.timeline.journal is not None:
            self.timeline.journal.append(partial(items.__delitem__, place))

    def cut(self, items: list[Moment], low: int, high: int) -> list[Moment]:
        """Take a part out of a list."""
        taken = items[low:high]
        del items[low:high]
        if self.timeline.journal is not None:
            self.timeline.journal.append(partial(items.__setitem__, slice(low, low), taken))
        return taken

    def put(self, items: MutableMapping[_K, _V], key: _K, value: _V) -> None:
        """Set a value in a dictionary."""
        if self.timeline.journal is not None:
            had = key in items
            self.timeline.journal.append(
                partial(items.__setitem__, key, items[key]) if had else partial(items.pop, key)
            )
        items[key] = value

    def pop(self, items: MutableMapping[_K, _V], key: _K) -> _V:
        """Take a value out of a dictionary."""
        value = items.pop(key)
        if self.timeline.journal is not None:
            self.timeline.journal.append(partial(items.__setitem__, key, value))
        return value

    def append(self, items: MutableSequence[_V], item: _V) -> None:
        """Append to a list or queue."""
        items.append(item)
        if self.timeline.journal is not None:
            self.timeline.journal.append(items.pop)

    def count(self, steps: int) -> None:
        """Count steps that are waited about, or not any more. Raises `EngineError` where there are too many."""
        self.opened += steps
        if self.opened > MAX_OPEN:
            self.refuse()

    def refuse(self) -> NoReturn:
        """Raise the `EngineError` of too many."""
        raise EngineError(
            f"more than {MAX_OPEN:,} of its obligations are open at once; give them an upper bound, or a smaller one"
        )


class Above(Protocol):
    """Who asks a node."""

    def resolved(self, key: Key, slot: int, about: Moment, value: int) -> None:
        """Take an answer that was open; `slot` is the node's place among the operands."""
        ...


class Awaited(Protocol):
    """A part of what is awaited."""

    above: Above
    slot: int

    def step(self, key: Key, ask: bool) -> int:
        """Take the present step; the answer about it where it is asked for."""
        ...

    def cancel(self, key: Key, about: Moment) -> None:
        """Forget an open question."""
        ...

    def passed(self, key: Key) -> None:
        """Settle what time has decided."""
        ...

    def quiet(self, key: Key) -> int | None:
        """The answer about a step at which no operand changes; None where it is open, or something changes with it."""
        ...

    def is_still(self, key: Key) -> bool:
        """Whether a step at which no operand changes changes nothing."""
        ...

    def snapshot(self) -> Any:
        """All rows as plain data."""
        ...

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        ...


class Deadlines:
    """When the starts of a node are over, the earliest first; those that were met meanwhile are skipped."""

    __slots__ = ("_present", "queue", "reach", "stale")

    def __init__(self, present: Present, upper: int | None) -> None:
        self._present = present
        self.reach = 0 if upper is None else upper + present.slack
        """How much later than a start the last time is at which it is not over, where there is one."""
        self.queue: deque[tuple[Key, Moment]] = deque()
        self.stale = False
        """Whether a start was met since the queue was looked through."""

    def add(self, key: Key, start: Moment) -> None:
        """A start, which is over some time."""
        self.queue.append((key, start))
        if self._present.timeline.journal is not None:
            self._present.timeline.journal.append(self.queue.pop)

    @property
    def first(self) -> int | None:
        """The last time at which the earliest one is not over."""
        return self.queue[0][1][0] + self.reach if self.queue else None

    def later(self, after: int) -> int | None:
        """The first time later than this one at which some are over that were not before."""
        place = bisect_left(self.queue, after - self.reach, key=_time)
        return self.queue[place][1][0] + self.reach + 1 if place < len(self.queue) else None

    def take(self) -> Collection[Key]:
        """The keys at which some are over; there are deadlines."""
        queue, now, reach = self.queue, self._present.now, self.reach
        found: dict[Key, None] = {}
        while queue and queue[0][1][0] + reach < now:
            found[self._pop()[0]] = None
        return list(found)

    def drop(self, rows: Mapping[Key, Waits]) -> None:
        """Skip those of which no row waits any more."""
        self.stale = False
        queue = self.queue
        while queue:
            key, start = queue[0]
            row = rows.get(key)
            if row is not None and (row.starts[0] == start or place_of(row.starts, start) is not None):
                return
            queue.popleft()
            if self._present.timeline.journal is not None:
                self._present.timeline.journal.append(partial(queue.appendleft, (key, start)))

    def _pop(self) -> tuple[Key, Moment]:
        entry = self.queue.popleft()
        self._present.note(partial(self.queue.appendleft, entry))
        return entry


class Waits(Protocol):
    """A row: the steps about which something is awaited at a key."""

    starts: list[Moment]


def _time(entry: tuple[Key, Moment]) -> int:
    return entry[1][0]


def place_of(items: list[Moment], item: Moment) -> int | None:
    """Where an item stands in an ascending list, None where it does not."""
    place = bisect_left(items, item)
    return place if place < len(items) and items[place] == item else None


def moments(data: Iterable[Sequence[int]]) -> list[Moment]:
    """Moments out of plain data, where tuples are lists."""
    return [(time, number) for time, number in data]
