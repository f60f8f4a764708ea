"""What is sent between the events: clocks of streams, and handlings: what was done with asks.

Each has its place in the order of the queue, and is due once no event before that place waits to be
sent.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Deque, Dict, Iterable, Iterator, List, Optional, Tuple

from oracle_adapter.jsonvalues import dumps

if TYPE_CHECKING:
    from oracle_adapter.queued import Queued

ClockStamp = Tuple[str, str, int]
"""A stream's name, its kind, and the publication time (ns) before which nothing more will come."""
CLOCKS_APART = 10**8
"""Nanoseconds between two clocks that wait, at least, with events between them."""
MAX_CLOCKS = 1000
"""Clocks that wait, as while the server is away; for more every second one is forgotten."""


@dataclass
class _ClockMark:
    after: int
    stamps: Dict[Tuple[str, str], int]

    @property
    def newest(self) -> int:
        """The newest of its times (ns)."""
        return max(self.stamps.values())


@dataclass
class Handling:
    """What was done with an event after its ask; the frames call it an outcome."""

    event: Queued
    passed: bool
    why: str
    mark: int = 0  # the highest number on the wire when it was sent


class Marks:
    """Clocks, and at most `capacity` handlings that wait and as many that were sent.

    Where that is not enough, the newest that would wait and the oldest that was sent are forgotten:
    history then does not know what was done with those asks.
    """

    def __init__(self, capacity: int) -> None:
        self.max_handlings = 1
        """How many handlings a frame may have."""
        self._capacity = capacity
        self._clocks: List[_ClockMark] = []
        self._apart = CLOCKS_APART
        self._handlings: Deque[Handling] = deque()
        self._reported: Deque[Handling] = deque(maxlen=capacity)

    def __len__(self) -> int:
        return len(self._clocks) + len(self._handlings)

    @property
    def barrier(self) -> Optional[int]:
        """The event that the next clock follows: later events are sent after that clock."""
        return self._clocks[0].after if self._clocks else None

    def clock(self, stamps: Iterable[ClockStamp], after: int) -> None:
        """Place clocks after an event, replacing older ones of the same streams."""
        fresh = {(stream, kind): stamp for stream, kind, stamp in stamps}
        if not fresh:
            return
        # The newest takes over only what waits in the last place. The first keeps its place:
        # moved back each time, it would never be sent while events keep coming. So does one behind
        # which events came: by the time of before it they would be far ahead of their time.
        if len(self._clocks) < 2:
            self._apart = CLOCKS_APART
        elif not self._stays(after):
            fresh = {**self._clocks.pop().stamps, **fresh}
        self._clocks.append(_ClockMark(after, fresh))
        if len(self._clocks) > MAX_CLOCKS:
            del self._clocks[1:-1:2]
            took = self._clocks[-1].newest - self._clocks[0].newest
            self._apart = max(self._apart, 2 * took // MAX_CLOCKS)

    def _stays(self, after: int) -> bool:
        """Whether the last clock stays where it is, with an event between it and the next."""
        before, last = self._clocks[-2:]
        return last.after < after and last.newest - before.newest >= self._apart

    def turn_back(self, stamps: Iterable[ClockStamp], after: int) -> None:
        """Place clocks that go back after an event, instead of all that wait.

        They go back from the next instant, which is told first: what a server that was started
        again knows of the times before, and one that was told none of them, is nothing.
        """
        back = {(stream, kind): stamp for stream, kind, stamp in stamps}
        if back:
            before = {key: stamp + 1 for key, stamp in back.items()}
            self._clocks = [_ClockMark(after, before), _ClockMark(after, back)]

    def handled(self, event: Queued, passed: bool, why: str) -> None:
        """Place what was done with an ask after its event."""
        if len(self._handlings) < self._capacity:
            self._handlings.append(Handling(event, passed, why))

    def next_frame(self, front: Optional[int], highest: int) -> Optional[str]:
        """The next frame that is due.

        `front` is the first event that waits, `highest` the highest number sent.
        """
        handlings = list(self._due_handlings(front, highest))
        if handlings:
            return _handlings_text(handlings)
        if self._clocks and (front is None or self._clocks[0].after < front):
            return _clock_text(self._clocks.pop(0))
        return None

    def _due_handlings(self, front: Optional[int], highest: int) -> Iterator[Handling]:
        for _ in range(self.max_handlings):
            if not self._handlings or (
                front is not None and self._handlings[0].event.number >= front
            ):
                return
            handling = self._handlings.popleft()
            if handling.event.seq is not None:  # else the event was given up
                handling.mark = highest
                self._reported.append(handling)
                yield handling

    def acked(self, upto: int) -> None:
        """Forget handlings that have arrived: the server, reading in order, acked a later event."""
        while self._reported and self._reported[0].mark < upto:
            self._reported.popleft()

    def rewind(self) -> None:
        """Send again what may not have arrived."""
        self._handlings.extendleft(reversed(self._reported))
        self._reported.clear()

    def of_later(self, last: int) -> Marks:
        """Those of the next session: handlings of events after the `last` one of this."""
        marks = Marks(self._capacity)
        marks._handlings.extend(item for item in self._handlings if item.event.number > last)
        return marks

    def forget_numbered(self) -> None:
        """Drop handlings of events whose numbers now mean other events."""
        self._reported.clear()
        self._handlings = deque(item for item in self._handlings if item.event.seq is None)


def _handlings_text(handlings: List[Handling]) -> str:
    items = [{"seq": h.event.seq, "passed": h.passed, "why": h.why} for h in handlings]
    if len(items) == 1:
        return dumps({"type": "outcome", **items[0]})
    return dumps({"type": "outcomes", "outcomes": items})


def _clock_text(clock: _ClockMark) -> str:
    stamps = [
        {"stream": stream, "kind": kind, "stamp": stamp}
        for (stream, kind), stamp in clock.stamps.items()
    ]
    return dumps({"type": "clock", "stamps": stamps})
