"""Whether an adapter receives what is published: while it may not, it must send no clocks.

A middleware can stall for some 100 ms, for instance while it discovers a new process, and gives no
sign of it: the messages of that time then arrive all at once, and would be late.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Tuple

BUSY = 25
"""Messages per second from which on silence may be a stall."""
WINDOW = 1.0
SILENCE = 0.04
"""Seconds without a message after which a busy adapter may be in a stall."""
LONGEST_STALL = 1.0
"""Seconds of silence that are no stall: nothing is published."""
SETTLE = 0.15
"""Seconds that delayed messages may take to arrive, after the first of them."""


class Attention:
    """Counts messages, and detects suspicious silence; all times are in seconds."""

    def __init__(self) -> None:
        self._total = self._recent = 0
        self._received: Deque[Tuple[float, int]] = deque()
        self._suspicious = False
        self._settled = 0.0

    def is_paid(self, now: float, total: int) -> bool:
        """Whether clocks may be sent; `total` messages were received so far."""
        fresh, self._total = max(0, total - self._total), total
        if fresh:
            if self._suspicious:
                self._settled = now + SETTLE
            self._suspicious = False
            self._add(now, fresh)
        elif self._received and self._recent >= BUSY:
            self._suspicious = SILENCE < now - self._received[-1][0] < LONGEST_STALL
        return not self._suspicious and now >= self._settled

    def _add(self, now: float, fresh: int) -> None:
        self._received.append((now, fresh))
        self._recent += fresh
        while self._received[0][0] < now - WINDOW:
            self._recent -= self._received.popleft()[1]
