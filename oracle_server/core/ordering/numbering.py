"""A monitor's sequence numbers: which are new, repeated or lost, and up to where all are committed."""

from __future__ import annotations

import heapq
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from typing import Any

JUDGED = -1
"""In place of the loss of a refused event: the event was judged, and reported what was lost before it."""


class Numbering:
    """Counts one monitor's events 1, 2, 3… over all its connections to one session.

    A number is taken once; it is used up, with the gap before it, when its event is judged or refused and committed.
    """

    def __init__(self, committed: Iterable[tuple[int, int, int]] = (), saved: Any = None) -> None:
        """Continue from what was `saved`, and from what was committed by then or since.

        `committed` has a number each, the size of the gap before it, and how many events were lost with it where it
        was refused, else `JUDGED`.
        """
        upto, lost, done = saved or (0, 0, [])
        self.upto: int = upto
        """Every number up to here is used up."""
        self._lost: int = lost
        self._newest = 0
        self._done: list[tuple[int, int, int]] = [(first, last, size) for first, last, size in done]
        self._taken: set[int] = {last for _, last, _ in self._done}
        self._ahead: list[int] | None = None
        """Numbers above the newest that are taken, the largest first; some may be used up. None where it is unknown."""
        self._gaps = _Ranges()
        self._inside: set[int] = set()
        """Numbers that arrived after they were counted as lost, until they are used up."""
        self._awaited: list[int] = []
        """A heap of them; some may be used up."""
        for seq, gap, lost in sorted(committed):
            if seq > self.upto and seq not in self._taken:
                self._taken.add(seq)
                self.commit(seq, gap, lost)
        self.resume()

    def hold(self, seq: int) -> None:
        """Mark a number as taken that is not used up yet."""
        self._taken.add(seq)
        self._ahead = None

    @property
    def next(self) -> int:
        """The number that a monitor continues at."""
        return self._newest + 1

    @property
    def lost(self) -> int:
        """How many committed losses and refusals no judged event has reported yet."""
        lost, before = self._lost, self.upto
        for first, last, refused in sorted(self._done):
            if refused != JUDGED:
                lost += refused
            elif first <= before + 1:
                lost = 0  # reported with this event, which came next
            before = last
        return lost

    def saved(self) -> Any:
        """What is committed, as plain data."""
        return [self.upto, self._lost, sorted(self._done)]

    def resume(self) -> None:
        """Expect a monitor to send again all that is not used up."""
        self._newest, self._ahead = self.upto, None

    def restart(self) -> None:
        """Expect a monitor that does not know which numbers were taken."""
        self._newest, self._ahead = max(self.upto, *self._taken) if self._taken else self.upto, None

    def take(self, seq: int) -> int | None:
        """Take a number: the size of the gap before it, None where it was taken before."""
        before, self._newest = self._newest, max(self._newest, seq)
        if seq <= self.upto or seq in self._taken:
            return None
        gap = max(0, seq - 1 - before)
        if gap:
            gap -= self._count_taken(before, seq)
        if gap:
            self._gaps.forget(self.upto)
            self._gaps.add(seq - gap, seq)
        if seq in self._gaps:
            self._inside.add(seq)
            heapq.heappush(self._awaited, seq)
        self._taken.add(seq)
        return gap

    def commit(self, seq: int, gap: int, lost: int = JUDGED) -> None:
        """Use up a number that was taken, and the gap before it, of which nothing is expected any more."""
        self._inside.discard(seq)
        heapq.heappush(self._done, (seq - gap, seq, lost))
        while self._done and self._done[0][0] <= self.upto + 1:
            _, end, refused = self._done[0]
            while self._awaited and self._awaited[0] not in self._inside:
                heapq.heappop(self._awaited)
            if self._awaited and self._awaited[0] < end:
                self.upto = max(self.upto, self._awaited[0] - 1)
                break
            heapq.heappop(self._done)
            self._taken.discard(end)
            self._lost = 0 if refused == JUDGED else self._lost + refused
            self.upto = max(self.upto, end)

    def _count_taken(self, before: int, seq: int) -> int:
        """How many numbers between two are taken, the first of which was the newest; the second one is now."""
        if self._ahead is None:
            self._ahead = sorted([other for other in self._taken if other > before], reverse=True)
        count = 0
        while self._ahead and self._ahead[-1] < seq:
            other = self._ahead.pop()
            count += other > before and other in self._taken
        return count


class _Ranges:
    """Ranges of numbers, each from a first one to before an end; those that touch are one."""

    def __init__(self) -> None:
        self._firsts: list[int] = []
        self._ends: list[int] = []

    def __contains__(self, number: int) -> bool:
        found = bisect_right(self._firsts, number) - 1
        return found >= 0 and number < self._ends[found]

    def add(self, first: int, end: int) -> None:
        """Add a range, of which some may be there."""
        begin, behind = bisect_left(self._ends, first), bisect_right(self._firsts, end)
        if begin < behind:
            first, end = min(first, self._firsts[begin]), max(end, self._ends[behind - 1])
        self._firsts[begin:behind], self._ends[begin:behind] = [first], [end]

    def forget(self, upto: int) -> None:
        """Forget ranges that have no number behind one: nobody asks for these."""
        if self._ends and self._ends[0] <= upto + 1:
            count = bisect_right(self._ends, upto + 1)
            del self._firsts[:count], self._ends[:count]
