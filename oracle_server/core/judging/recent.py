"""The last steps of a session, for explanations to point at."""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Collection
from typing import Any, Final

from oracle_server.core.atoms import Matches
from oracle_server.core.events import TICKS, Signals, Step, StreamKey
from oracle_server.core.kinds import TICK
from oracle_server.core.naming import event_name
from oracle_server.core.past import Past, Seen
from oracle_server.core.plan import View
from oracle_server.core.records import EventRecord

SIZE = 1024
"""Steps that are remembered; of older ones an explanation has the number or the time only."""
LENGTH = 2**20
"""Characters of texts in the signals of that many steps: where the later ones have more, older ones are forgotten."""
EFFORT = 10_000
EFFORT_TOGETHER = 50_000
"""What the explanations of all properties may have cost at one step before another one begins."""
"""What one explanation may cost: some milliseconds."""

Kept = tuple[int, int, StreamKey, int, str, int, Signals, Collection[str], int, int | None]
"""A step's place and time, its event's stream, stamp, monitor and number there, its signals, those that failed, the
step's number, which is its place but where late events were put in theirs, and the event's row."""
_NUMBER: Final = 8
Tick = tuple[int, View, Signals, Collection[str]]
"""The time of a deadline that is being judged, how a property observes it, its signals, and those that failed."""
_NONE: frozenset[str] = frozenset()


class Recent:
    """The last steps; all times in nanoseconds."""

    def __init__(self, size: int = SIZE, effort: int = EFFORT, spare: int = 0) -> None:
        """Remember so many steps, and so many more that are there again where the last ones are removed."""
        self._steps: deque[Kept] = deque(maxlen=size + spare)
        self._upto: deque[int] = deque(maxlen=size + spare)
        """How many characters there were up to each of them, itself included."""
        self._size, self._effort, self._spare, self._length = size, effort, spare, LENGTH * size // SIZE
        self.number: int | None = None
        """The number of the step that is added next; None where that is its place."""
        self._unnumbered = False
        """Whether the last step is an attempt that is about to be taken back, so that its number will be another's."""

    def add(self, place: int, time: int, step: Step, signals: Signals, failed: Collection[str] = _NONE) -> None:
        """Add the next step, of which formulas see `signals`; those in `failed` could not be computed."""
        event, self._unnumbered = step.event, False
        number = place if self.number is None else self.number
        self._append(
            (place, time, event.stream, step.stamp, event.monitor, event.seq, signals, failed, number, event.row)
        )

    def unnumber(self) -> None:
        """Let explanations not give the number of the last step: it is an attempt that is about to be taken back."""
        self._unnumbered = True

    def remove(self, count: int = 1) -> None:
        """Forget the last steps."""
        for _ in range(min(count, len(self._steps))):
            self._steps.pop()
            self._upto.pop()
        self._unnumbered = False

    def forget(self, spare: int) -> None:
        """Forget what is not remembered any more where at most `spare` of the last steps are removed."""
        while len(self._steps) > self._size + spare:
            self._steps.popleft()
            self._upto.popleft()

    def named(self, place: int) -> str:
        """A step, given by its place: by its number, where that may be another and is known."""
        index = place - self._steps[0][0] if self._steps else -1
        if 0 <= index < len(self._steps):
            return f"step {self._steps[index][_NUMBER]}"
        return f"place {place}" if self._spare else f"step {place}"

    def last(self) -> EventRecord:
        """The event of the last step; before the first one, and of what is judged without it, one of no stream."""
        if not self._steps:
            return {"stream": "", "kind": TICK, "stamp": 0, "monitor": "", "seq": 0, "signals": {}}
        return {"step": self._steps[-1][_NUMBER], **_record(self._steps[-1])}

    def snapshot(self) -> list[Any]:
        """The steps as plain data."""
        return [(*rest, sorted(failed), number, row) for *rest, failed, number, row in self._last]

    def restore(self, data: Any) -> None:
        """Take over a snapshot; older ones lack the signals that failed, numbers other than places, and rows."""
        for place, time, stream, stamp, monitor, seq, signals, *more in data:
            known: list[Any] = [*more, *(_NONE, place, None)[len(more) :]]
            failed, number, row = known
            self._append((place, time, StreamKey(*stream), stamp, monitor, seq, signals, failed, number, row))

    def past(
        self,
        views: Callable[[StreamKey], View],
        tick: Tick | None = None,
        spent: Callable[[int], None] | None = None,
        unread: Callable[[StreamKey], Collection[str]] = lambda _: _NONE,
    ) -> Past:
        """These steps, and a tick after them, as a property observes them by its view of each stream.

        `spent` is told what the explanation costs; `unread` are the derived signals that a stream's steps, and ticks,
        do not have since no formula reads them there.
        """
        steps = self._last
        times = [time for _, time, *_ in steps] + ([] if tick is None else [tick[0]])

        def matches(place: int) -> Matches:
            if place < len(steps):
                return views(steps[place][2]).matches(steps[place][6])
            assert tick is not None  # noqa: S101 -- else there is no such step
            return tick[1].matches(tick[2])

        def seen(place: int) -> Seen:
            if place < len(steps):
                known = _seen(steps[place])._replace(unread=unread(steps[place][2]))
                return known._replace(number=None) if self._unnumbered and place == len(steps) - 1 else known
            assert tick is not None  # noqa: S101 -- else there is no such step
            return Seen(None, tick[0], "", tick[2], tick[3], unread(TICKS))

        noun = "step" if all(kept[0] == kept[_NUMBER] for kept in steps) else "place"
        return Past(times, matches, self._effort, seen, spent, noun)

    def _append(self, kept: Kept) -> None:
        upto = self._upto
        length = sum([len(value) for value in kept[6].values() if type(value) is str])
        upto.append(length + (upto[-1] if upto else 0))
        self._steps.append(kept)
        while not self._spare and upto[-1] - upto[0] > self._length:
            upto.popleft()
            self._steps.popleft()

    @property
    def _last(self) -> list[Kept]:
        if not self._steps:
            return []
        long = bisect_left(self._upto, self._upto[-1] - self._length)
        return list(itertools.islice(self._steps, max(long, len(self._steps) - self._size), None))

    def recall(self, at: int, step: int | None, *, timed: bool) -> EventRecord | None:
        """The event of a reason: of a step at a place, if that is known, else the only one at a time or place."""
        place, wanted = (1, at) if timed and step is None else (0, at if step is None else step)
        found = [seen for seen in self._steps if seen[place] == wanted]
        if len(found) != 1:
            return None
        record = _record(found[0])
        if not (self._unnumbered and found[0] is self._steps[-1]):
            record["step"] = found[0][_NUMBER]
        return record


def _seen(kept: Kept) -> Seen:
    _, _, stream, stamp, monitor, seq, signals, failed, number, row = kept
    return Seen(number, stamp, event_name(stream.name, stream.kind, seq, monitor, row), signals, failed)


def _record(kept: Kept) -> EventRecord:
    _, _, stream, stamp, monitor, seq, signals, _, _, row = kept
    found: EventRecord = {
        "stream": stream.name,
        "kind": stream.kind,
        "stamp": stamp,
        "monitor": monitor,
        "seq": seq,
        "signals": dict(signals),
    }
    if row is not None:
        found["row"] = row
    return found
