"""A timeout for many waits, one after the other, that costs next to nothing where the waits are short."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


class ReusableTimeout:
    """Uses one timer of the event loop, which is left running between the waits instead of being set for each."""

    def __init__(self, seconds: float, expired: Callable[[], None]) -> None:
        """Call `expired` once a wait has taken `seconds`."""
        self._seconds, self._expired = seconds, expired
        self._loop = asyncio.get_running_loop()
        self._since: float | None = None
        self._timer: asyncio.TimerHandle | None = None

    def begin(self) -> None:
        """Begin a wait."""
        self._since = self._loop.time()
        if self._timer is None:
            self._timer = self._loop.call_later(self._seconds, self._check)

    def end(self) -> None:
        """End the wait."""
        self._since = None

    def stop(self) -> None:
        """End the wait, if there is one, and cancel the timer."""
        self.end()
        if self._timer is not None:
            self._timer.cancel()

    def _check(self) -> None:
        self._timer = None
        if self._since is None:
            return
        left = self._since + self._seconds - self._loop.time()
        if left > 0:
            self._timer = self._loop.call_later(left, self._check)
        else:
            self._expired()
