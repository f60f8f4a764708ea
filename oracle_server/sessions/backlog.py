"""How much a restart would judge again: the steps of all open sessions that no snapshot has, and a bound on them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

MOST = 30_000
"""Steps that a restart should judge again, over all sessions: some two seconds."""
_WORTH = 100
"""Steps since the last snapshot of a session that are worth another one."""


class Saved(Protocol):
    """A session's snapshots."""

    @property
    def request(self) -> Callable[[], None]:
        """Takes a snapshot now."""
        ...

    @property
    def rested(self) -> bool:
        """Whether another one may be taken already."""
        ...


class Backlog:
    """The steps since each session's last snapshot; beyond `most` the session that has most of them is saved.

    So one busy session is saved seldom, and of many that have been quiet each is when it is its turn. Sessions that
    can't be saved do not count.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._steps: dict[Saved, int] = {}
        self._total = 0
        self._relieving = False

    @property
    def total(self) -> int:
        """The steps of all sessions that a restart would judge again."""
        return self._total

    def restored(self, session: Saved, steps: int) -> None:
        """Note how many steps of a restored session were judged again: nothing is saved while others wait for that."""
        self._note(session, steps)

    def count(self, session: Saved, steps: int) -> None:
        """Note how many steps a session has judged since its last snapshot."""
        self._note(session, steps)
        if self._total > self._most and not self._relieving:
            self._relieving = True
            asyncio.get_running_loop().call_soon(self._relieve)

    def forget(self, session: Saved) -> None:
        """Forget a session that is closed, or can't be saved."""
        self._total -= self._steps.pop(session, 0)

    def _note(self, session: Saved, steps: int) -> None:
        self._total += steps - self._steps.get(session, 0)
        self._steps[session] = steps

    def _relieve(self) -> None:
        """Save one session: the loop has other work between two."""
        self._relieving = False
        worth = [one for one, steps in self._steps.items() if steps >= _WORTH and one.rested]
        if worth:
            max(worth, key=self._steps.__getitem__).request()
