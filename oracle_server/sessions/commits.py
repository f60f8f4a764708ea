"""A session's commits, as something that readers of its history can wait for."""

from __future__ import annotations

import asyncio


class Commits:
    """Wakes those that wait for the next commit; a commit that nobody waits for costs nothing."""

    def __init__(self) -> None:
        self.ended = False
        """Whether there will be no more commits."""
        self._next: asyncio.Future[None] | None = None

    def notify(self) -> None:
        """Report a commit."""
        upcoming, self._next = self._next, None
        if upcoming is not None and not upcoming.done():
            upcoming.set_result(None)

    def end(self) -> None:
        """Report that there will be no more commits."""
        self.ended = True
        self.notify()

    def next(self) -> asyncio.Future[None]:
        """A future that is done at the next commit, or at the end. All share it: wait for it with `asyncio.wait`."""
        upcoming = self._next or asyncio.get_running_loop().create_future()
        if self.ended:
            upcoming.set_result(None)
        else:
            self._next = upcoming
        return upcoming
