"""When asks run out of time: many deadlines, one timer."""

from __future__ import annotations

from heapq import heappop, heappush
from typing import Container, List, Optional, Tuple


class Deadlines:
    """Asks by the time (s) at which they run out, and the time that the one timer is set to.

    An ask that is answered stays until the timer finds it: setting a timer for each would cost
    more than all else that an ask does.
    """

    def __init__(self) -> None:
        self.timer: Optional[float] = None
        """What the timer is set to, or is to be; None where it is not."""
        self._heap: List[Tuple[float, int]] = []

    def add(self, at: float, number: int) -> bool:
        """Take one in; true where the timer must be set earlier for it, which is noted as done."""
        heappush(self._heap, (at, number))
        if self.timer is not None and self.timer <= at:
            return False
        self.timer = at
        return True

    def take_due(self, now: float, waiting: Container[int]) -> List[int]:
        """The waiting that have run out; `timer` is then what the timer is to be set to next."""
        due = []
        while self._heap and (self._heap[0][0] <= now or self._heap[0][1] not in waiting):
            _, number = heappop(self._heap)
            if number in waiting:
                due.append(number)
        self.timer = self._heap[0][0] if self._heap else None
        return due
