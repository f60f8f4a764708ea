"""What is on its way to the server, in the order it was queued.

Events wait in `_unsent`, move to `_sent` as they are written, and leave when the server has acked
them; after a reconnect those that the server lacks move back. `_sent` followed by `_unsent` is
always in the order of queueing.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Callable, Deque, Dict, Iterable, List, Optional

from oracle_adapter.marks import ClockStamp, Marks
from oracle_adapter.queued import HEAD, Queued

if TYPE_CHECKING:
    from oracle_adapter.stats import Stats

MAX_FRAME = 1 << 20
"""Bytes of a frame, where the server names no limit."""
BATCH = 1 << 17
"""Bytes of a batch of events: larger ones save nothing, and keep pings waiting on a slow line."""
ROOM = 1 << 28
"""Bytes that events may take while they are held: a robot has little memory, and other programs."""
FULL = 3 / 4
"""How full the queue may get before events go without credit: losing them is worse."""


class Outbox:
    """The queue of one monitor: at most `capacity` events and `ROOM`, sent ones until acked."""

    def __init__(self, capacity: int, stats: Stats) -> None:
        self.asked: Dict[int, Queued] = {}
        """Asks that wait for an answer, by the number they were sent with."""
        self.marks = Marks(capacity)
        self.credit: Optional[int] = None
        """How many events the server has room for, None where it does not limit them."""
        self._urgent = 0  # the newest ask: it waits for no credit, nor do events before it
        self._capacity, self._stats = capacity, stats
        self._max_frame, self._max_batch = MAX_FRAME, capacity
        self._unsent: Deque[Queued] = deque()
        self._sent: Deque[Queued] = deque()
        self._held = 0  # bytes of both
        self._count = 0  # events queued so far
        self._missed = 0  # events lost since the last one queued
        self._acked = 0
        self._next: Optional[int] = (
            None  # number of the next new event, once the server has named it
        )
        self._last_here: Optional[int] = (
            None  # the last event of this session, once its end is near
        )
        self._last_clocks: List[ClockStamp] = []  # the clocks that end it
        self._overtaken = False  # others have ended the last session, and nothing went to this one

    def __len__(self) -> int:
        return len(self._unsent) + len(self._sent)

    @property
    def crowded(self) -> bool:
        """Whether little room is left."""
        return len(self) > FULL * self._capacity or self._held > FULL * ROOM

    @property
    def unsent(self) -> int:
        """How many events were never written, or are to be written again."""
        return len(self._unsent)

    def put(
        self, stamp: Optional[int], body: str, *, lost: int = 0, ask: bool = False
    ) -> Optional[Queued]:
        """Queue an event; or count it as lost and return None, where it is too many or too large.

        `body` is the event's JSON from `"stream"` to its closing brace. What was lost is the
        next event's `lost`.
        """
        lost += self._missed
        size = HEAD + len(body)
        full = len(self) >= self._capacity or self._held + size > ROOM
        if full or size > self._max_frame:
            self._missed = lost + 1
            self._stats.lost += 1
            return None
        self._missed = 0
        self._count += 1
        event = Queued(self._count, stamp, body, lost=lost, waiting=ask)
        self._unsent.append(event)
        self._held += size
        if ask:
            self._urgent = event.number
        return event

    def is_too_large(self, body: str) -> bool:
        """Whether an event is more than a frame may be."""
        return HEAD + len(body) > self._max_frame

    def miss(self, count: int) -> bool:
        """Count events that were lost before they came here: the next event tells it.

        True where some are lost that none has told yet.
        """
        self._missed += count
        return self._missed > 0

    def clock(self, stamps: Iterable[ClockStamp]) -> None:
        """Queue clocks after every event queued so far."""
        if self._last_here is None:
            self.marks.clock(stamps, after=self._count)

    def renew(self, stamps: Iterable[ClockStamp]) -> List[Queued]:
        """Let the session end after every event queued so far, by clocks that go back.

        What is queued from now on waits for the next session. Where others have gone back before,
        this is that session: what is queued is of the last one, and returned.
        """
        back = list(stamps)
        if (
            self._last_here is not None or not back
        ):  # without any, the next clock goes back by itself
            return []
        if self._overtaken:
            upcoming = self._next
            dropped = self.start_over()
            self._next = upcoming
            self.clock(back)
            return dropped
        self._last_clocks = back
        self._last_here = self._count
        self.marks.turn_back(self._last_clocks, after=self._last_here)
        return []

    def start_over(self) -> List[Queued]:
        """Continue in another session; returns the events that the last one has not taken."""
        events = [*self._sent, *self._unsent]
        last = self._count if self._last_here is None else self._last_here
        dropped = [event for event in events if event.number <= last]
        self._stats.lost += sum(event.seq is None or event.seq > self._acked for event in dropped)
        self._sent.clear()
        self._unsent = deque(event for event in events if event.number > last)
        self._held -= sum(event.size for event in dropped)
        self.asked.clear()
        self.marks = self.marks.of_later(last)
        if self._last_here is not None:
            # A straggler from the time before the jump would set the session's time: all after it
            # would be late.
            self.marks.clock(self._last_clocks, after=last)
        self._missed = self._acked = 0
        self._overtaken = self._last_here is None
        self._next = self._last_here = None
        return dropped

    def move(self) -> None:
        """Continue in a new session with all that is not known to be in the last one's history."""
        self._rewind(0)
        self.marks.rewind()
        self._forget_numbers()
        self._acked = 0
        self._next = self._last_here = None

    def ack(self, upto: int) -> None:
        """Forget every event up to there."""
        self._acked = max(self._acked, upto)
        self._release()
        self.marks.acked(self._acked)

    def answered(self, event: Queued) -> None:
        """An ask has its answer, whatever it is."""
        event.waiting = False
        if event.seq is not None:
            self.asked.pop(event.seq, None)
            self._release()

    def resume(
        self, upcoming: int, max_frame: int, max_batch: Optional[int], first: int = 0
    ) -> List[Queued]:
        """Continue from the number that the server expects; returns events that are lost by it.

        Numbers below `first` are those of another process of the monitor's name.
        """
        self._max_frame, self._max_batch = max_frame, max_batch or self._capacity
        if self._next is None:
            self._next = upcoming
        elif upcoming > self._next or self._oldest(first) < first:
            return self._renumber(upcoming)
        # Where the server has forgotten events that it acked, the gap in the numbers shows it.
        self._stats.lost += max(0, self._oldest(self._next) - upcoming)
        if self._last_here is not None:
            self.marks.turn_back(self._last_clocks, after=self._last_here)
        asks = [event.seq for event in self._sent if event.waiting and event.seq is not None]
        self._rewind(min([upcoming, *asks]))
        self.marks.rewind()
        return self._give_up(lambda event: event.size > max_frame)

    def next_frame(self) -> Optional[str]:
        """The next frame to write, or None where nothing is due."""
        front = self._unsent[0].number if self._unsent else None
        mark = self.marks.next_frame(front, highest=(self._next or 1) - 1)
        if mark is not None or front is None or not self._may_go(front):
            self._overtaken = self._overtaken and mark is None
            return mark
        self._overtaken = False
        batch = self._take_batch()
        return batch[0] if len(batch) == 1 else f'{{"type":"events","events":[{",".join(batch)}]}}'

    def _may_go(self, number: int) -> bool:
        if self._last_here is not None and number > self._last_here:
            return False
        enough = self.credit is None or self.credit > 0 or number <= self._urgent
        return enough or self.crowded

    def _take_batch(self) -> List[str]:
        batch: List[str] = []
        room = min(BATCH, self._max_frame // 2)
        barrier = self.marks.barrier
        while self._unsent and len(batch) < self._max_batch:
            event = self._unsent[0]
            room -= event.size
            if batch and (room < 0 or (barrier is not None and event.number > barrier)):
                break
            if not self._may_go(event.number):
                break
            self._unsent.popleft()
            if self.credit is not None:
                self.credit -= 1
            self._number(event)
            self._sent.append(event)
            batch.append(event.text())
        self._release()  # some were acked, and were sent again with an ask before them
        return batch

    def _number(self, event: Queued) -> None:
        if event.seq is not None:
            self._stats.resent += 1
            return
        event.seq = self._next or 1
        self._next = event.seq + 1
        self._stats.sent += 1
        if event.waiting:
            self.asked[event.seq] = event

    def _release(self) -> None:
        while self._sent and (self._sent[0].seq or 0) <= self._acked:
            if self._sent[0].waiting:
                break  # the decision may be lost with the connection: this must be asked again
            self._held -= self._sent.popleft().size
            self._stats.acked += 1

    def _oldest(self, upcoming: int) -> int:
        for events in (self._sent, self._unsent):
            if events:
                return events[0].seq or upcoming
        return upcoming

    def _rewind(self, start: int) -> None:
        while self._sent and (self._sent[-1].seq or 0) >= start:
            self._unsent.appendleft(self._sent.pop())

    def _renumber(self, upcoming: int) -> List[Queued]:
        """Continue after numbers of another process, which has used the monitor's name.

        Which of the events in flight with lower numbers the server has is unknown: these may mean
        that one's. It has no event with a higher one.
        """
        self._rewind(0)
        self.marks.rewind()
        self._next = upcoming
        dropped = self._give_up(
            lambda event: (event.seq or upcoming) < upcoming or event.size > self._max_frame
        )
        self._forget_numbers()
        return dropped

    def _forget_numbers(self) -> None:
        """Number anew all that waits."""
        for event in self._unsent:
            event.seq = None
        self.marks.forget_numbered()
        self.asked.clear()

    def _give_up(self, doomed: Callable[[Queued], bool]) -> List[Queued]:
        kept: Deque[Queued] = deque()
        dropped: List[Queued] = []
        missed = 0
        for event in self._unsent:
            if doomed(event):
                dropped.append(event)
                missed += event.lost + 1
            else:
                event.lost += missed
                missed = 0
                kept.append(event)
        self._unsent = kept
        self._held -= sum(event.size for event in dropped)
        self._missed += missed
        self._stats.lost += len(dropped)
        return dropped
