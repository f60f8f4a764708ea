"""A monitor's sequence numbers: which are new, repeated or lost, and up to where all are committed."""

from __future__ import annotations

import heapq
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
        self._gaps: dict[int, int] = {}
        self._last_gap = 0
        self._inside: set[int] = set()
        """Numbers that arrived after they were counted as lost, until they are used up."""
        for seq, gap, lost in sorted(committed):
            if seq > self.upto and seq not in self._taken:
                self._taken.add(seq)
                self.commit(seq, gap, lost)
        self.resume()

    def hold(self, seq: int) -> None:
        """Mark a number as taken that is not used up yet."""
        self._taken.add(seq)

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
        self._newest = self.upto

    def restart(self) -> None:
        """Expect a monitor that does not know which numbers were taken."""
        self._newest = max(self.upto, *self._taken) if self._taken else self.upto

    def take(self, seq: int) -> int | None:
        """Take a number: the size of the gap before it, None where it was taken before."""
        before, self._newest = self._newest, max(self._newest, seq)
        if seq <= self.upto or seq in self._taken:
            return None
        gap = max(0, seq - 1 - before)
        if gap:
            gap -= sum(1 for other in self._taken if before < other < seq)
        if gap:
            self._gaps[seq] = gap
            self._last_gap = max(self._last_gap, seq)
        if seq < self._last_gap and any(other - size <= seq < other for other, size in self._gaps.items()):
            self._inside.add(seq)
        self._taken.add(seq)
        return gap

    def commit(self, seq: int, gap: int, lost: int = JUDGED) -> None:
        """Use up a number that was taken, and the gap before it, of which nothing is expected any more."""
        self._inside.discard(seq)
        heapq.heappush(self._done, (seq - gap, seq, lost))
        while self._done and self._done[0][0] <= self.upto + 1:
            _, end, refused = self._done[0]
            if self._inside and (awaited := min(self._inside)) < end:
                self.upto = max(self.upto, awaited - 1)
                break
            heapq.heappop(self._done)
            self._taken.discard(end)
            self._gaps.pop(end, None)
            self._lost = 0 if refused == JUDGED else self._lost + refused
            self.upto = max(self.upto, end)
