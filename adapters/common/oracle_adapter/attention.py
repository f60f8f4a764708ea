"""Whether an adapter hears what is said: where it may be deaf, its clocks must be silent.

A middleware can hold up everything that it receives for some 100 ms, for instance while it gets to
know a new process, without a sign of it: what was said meanwhile comes at once, and would be late.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Tuple

BUSY = 25
"""Messages of a second from which on silence means something."""
WINDOW = 1.0
SILENCE = 0.04
"""Seconds without a message after which a busy adapter may be deaf."""
PATIENCE = 1.0
"""Seconds after which the silence is taken for what it is."""
SETTLE = 0.15
"""Seconds that what was held up may take to come, after the first of it."""


class Attention:
    """Counts what is heard, and tells when silence is suspicious; all times are seconds."""

    def __init__(self) -> None:
        self._total = self._recent = 0
        self._heard: Deque[Tuple[float, int]] = deque()
        self._suspicious = False
        self._settled = 0.0

    def is_paid(self, now: float, total: int) -> bool:
        """Whether clocks may tell that nothing older will come; `total` messages were heard."""
        fresh, self._total = max(0, total - self._total), total
        if fresh:
            if self._suspicious:
                self._settled = now + SETTLE
            self._suspicious = False
            self._add(now, fresh)
        elif self._heard and self._recent >= BUSY:
            self._suspicious = SILENCE < now - self._heard[-1][0] < PATIENCE
        return not self._suspicious and now >= self._settled

    def _add(self, now: float, fresh: int) -> None:
        self._heard.append((now, fresh))
        self._recent += fresh
        while self._heard[0][0] < now - WINDOW:
            self._recent -= self._heard.popleft()[1]
