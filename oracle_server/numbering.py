"""A monitor's sequence numbers: what is new, what came before, what was lost, and up to where all is committed."""

from __future__ import annotations

import heapq
from collections.abc import Iterable


class Numbering:
    """Counts one monitor's events 1, 2, 3… over all its connections to one session.

    A number is taken once; it is used up, with the gap before it, when its event is judged or refused and committed.
    """

    def __init__(self, committed: Iterable[tuple[int, int]] = ()) -> None:
        """Go on after what is committed: pairs of a number and the size of the gap before it."""
        self.upto = 0
        """Every number up to here is used up."""
        self._newest = 0
        self._taken: set[int] = set()
        self._done: list[tuple[int, int]] = []
        for seq, gap in committed:
            self._taken.add(seq)
            self.commit(seq, gap)
        self.resume()

    def hold(self, seq: int) -> None:
        """Know a number as taken that is not used up yet."""
        self._taken.add(seq)

    @property
    def next(self) -> int:
        """The number that a monitor goes on at."""
        return self._newest + 1

    def resume(self) -> None:
        """Expect a monitor to send again all that is not used up."""
        self._newest = self.upto

    def restart(self) -> None:
        """Expect a monitor that knows nothing of the numbers that were taken."""
        self._newest = max(self.upto, *self._taken) if self._taken else self.upto

    def take(self, seq: int) -> int | None:
        """Take a number: the size of the gap before it, None where it was taken before."""
        before, self._newest = self._newest, max(self._newest, seq)
        if seq <= self.upto or seq in self._taken:
            return None
        gap = max(0, seq - 1 - before)
        if gap:
            gap -= sum(1 for other in self._taken if before < other < seq)
        self._taken.add(seq)
        return gap

    def commit(self, seq: int, gap: int) -> None:
        """Use up a number that was taken, and the gap before it."""
        heapq.heappush(self._done, (seq - gap, seq))
        while self._done and self._done[0][0] <= self.upto + 1:
            _, end = heapq.heappop(self._done)
            self._taken.discard(end)
            self.upto = max(self.upto, end)
