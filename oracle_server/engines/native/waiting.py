"""What the nodes of an obligation have in common: values, the present moment, and changes that can be taken back.

A node is an operator, for all keys: what it waits for at a key is a *row*. The node above asks it about the present
step; it answers at once, or `OPEN`, and then tells its answer later. All changes are noted in the timeline's journal.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable, Mapping, MutableMapping, MutableSequence, Sequence
from functools import partial
from operator import itemgetter
from typing import Any, NoReturn, Protocol, TypeVar

from oracle_server.core.errors import EngineError
from oracle_server.engines.native.keys import Key, read_key
from oracle_server.engines.native.timeline import Timeline

FALSE, TRUE, LOST, OPEN = range(4)
"""What is known about a step. `LOST`: it can't be judged any more, since something failed."""
NEGATED = (TRUE, FALSE, LOST, OPEN)
MAX_OPEN = 100_000
"""Steps about which all nodes of a property together may wait: each takes some hundred bytes."""

Moment = tuple[int, int]
"""A step: its time, as the timeline has it, and its number."""
Starts = list[Moment] | deque[Moment]
"""Steps, oldest first: a list, which is small, or a queue, which loses its first ones at no cost."""
MANY = 256
"""Starts from which on they are a queue."""
SPARE = 64
"""Deadlines of what was met meanwhile that are kept at least."""
Deadline = tuple[int, Key, Moment]
"""The last time at which a start is not over, its key, and the start."""
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


def never() -> bool:
    """That nothing was enough yet."""
    return False


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

    def cut(self, items: Starts, low: int, high: int) -> list[Moment]:
        """Take a part out of ascending steps."""
        if isinstance(items, list):
            taken = items[low:high]
            del items[low:high]
        else:
            items.rotate(-low)
            taken = [items.popleft() for _ in range(high - low)]
            items.rotate(low)
        if self.timeline.journal is not None:
            self.timeline.journal.append(partial(_join, items, low, taken))
        return taken

    def start(self, row: Waits) -> None:
        """Wait about the present step too. Raises `EngineError` where there are too many."""
        starts, journal = row.starts, self.timeline.journal
        if len(starts) == MANY and isinstance(starts, list):
            if journal is not None:
                journal.append(partial(setattr, row, "starts", starts))
            starts = row.starts = deque(starts)
        starts.append(self.moment)
        if journal is not None:
            journal.append(starts.pop)
        self.opened += 1
        if self.opened > MAX_OPEN:
            self.refuse()

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

    __slots__ = ("_over", "_present", "_rows", "queue", "reach")

    def __init__(self, present: Present, rows: Mapping[Key, Waits], upper: int | None) -> None:
        self._present, self._rows = present, rows
        self.reach = 0 if upper is None else upper + present.slack
        """How much later than a start the last time is at which it is not over, where there is one."""
        self.queue: deque[Deadline] = deque()
        self._over: set[Key] = set()
        """Those of the present time that were taken."""

    def add(self, key: Key, start: Moment) -> None:
        """A start, which is over some time."""
        present, queue = self._present, self.queue
        if len(queue) > 2 * present.opened + SPARE:
            self._put(deque(each for each in queue if self._waits(each)))
            queue = self.queue
        queue.append((start[0] + self.reach, key, start))
        if present.timeline.journal is not None:
            present.timeline.journal.append(queue.pop)

    @property
    def first(self) -> int | None:
        """The last time at which the earliest one is not over."""
        self._drop()
        return self.queue[0][0] if self.queue else None

    def later(self, after: int) -> int | None:
        """The first time later than this one at which some are over that were not before."""
        self._drop()
        place = bisect_left(self.queue, after, key=_over)
        return self.queue[place][0] + 1 if place < len(self.queue) else None

    def take(self) -> Key | None:
        """The next key at which some are over; None behind the last one."""
        while self.queue and self.queue[0][0] < self._present.now:
            key = self._pop()[1]
            if key not in self._over:
                self._over.add(key)
                return key
        self._over.clear()
        return None

    def clear(self) -> None:
        """Skip all: no row waits any more."""
        if self._present.timeline.journal is None:
            self.queue.clear()
        elif self.queue:
            self._put(deque())

    def snapshot(self) -> Any:
        """Those that are not over, as plain data."""
        return [(key, start) for _, key, start in self.queue]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self.queue.extend((time + self.reach, read_key(key), (time, number)) for key, (time, number) in data)

    def _drop(self) -> None:
        """Skip the first ones, as far as no row waits for them any more."""
        while self.queue and not self._waits(self.queue[0]):
            self._pop()

    def _waits(self, deadline: Deadline) -> bool:
        _, key, start = deadline
        row = self._rows.get(key)
        if row is None or not row.starts:
            return False
        return row.starts[0] == start or place_of(row.starts, start) is not None

    def _pop(self) -> Deadline:
        entry = self.queue.popleft()
        self._present.note(partial(self.queue.appendleft, entry))
        return entry

    def _put(self, queue: deque[Deadline]) -> None:
        self._present.note(partial(setattr, self, "queue", self.queue))
        self.queue = queue


class Waits(Protocol):
    """A row: the steps about which something is awaited at a key."""

    starts: Starts


_over = itemgetter(0)


def _join(items: Starts, place: int, taken: list[Moment]) -> None:
    """Put back what was cut out."""
    if isinstance(items, list):
        items[place:place] = taken
    else:
        items.rotate(-place)
        items.extendleft(reversed(taken))
        items.rotate(place)


def reach(starts: Starts, about: Moment, lower: int, upper: int | None) -> tuple[int, int]:
    """The starts within whose bound a step is: from which place up to which."""
    low, time = 0, about[0]
    if upper is not None and starts and starts[0][0] < time - upper:
        low = bisect_left(starts, (time - upper,))
    if lower:
        high = bisect_left(starts, (time - lower + 1,))
    else:
        high = len(starts) if not starts or starts[-1] <= about else bisect_right(starts, about)
    return low, max(low, high)


def place_of(items: Starts, item: Moment) -> int | None:
    """Where an item stands in an ascending list, None where it does not."""
    place = bisect_left(items, item)
    return place if place < len(items) and items[place] == item else None


def starts_of(data: Iterable[Sequence[int]]) -> Starts:
    """Starts out of plain data."""
    found = moments(data)
    return found if len(found) <= MANY else deque(found)


def moments(data: Iterable[Sequence[int]]) -> list[Moment]:
    """Moments out of plain data, where tuples are lists."""
    return [(time, number) for time, number in data]
