"""Notices waits that take too long, at next to no cost where they are short."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


class Patience:
    """One timer for many waits, one after the other: it is left running between them and not set anew for each."""

    def __init__(self, seconds: float, exhausted: Callable[[], None]) -> None:
        """Call `exhausted` once a wait has taken `seconds`."""
        self._seconds, self._exhausted = seconds, exhausted
        self._loop = asyncio.get_running_loop()
        self._since: float | None = None
        self._timer: asyncio.TimerHandle | None = None

    def begin(self) -> None:
        """A wait begins."""
        self._since = self._loop.time()
        if self._timer is None:
            self._timer = self._loop.call_later(self._seconds, self._look)

    def end(self) -> None:
        """It is over."""
        self._since = None

    def stop(self) -> None:
        """There will be no more waits."""
        self.end()
        if self._timer is not None:
            self._timer.cancel()

    def _look(self) -> None:
        self._timer = None
        if self._since is None:
            return
        left = self._since + self._seconds - self._loop.time()
        if left > 0:
            self._timer = self._loop.call_later(left, self._look)
        else:
            self._exhausted()
