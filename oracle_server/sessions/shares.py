"""The event loop's time, shared out: a session that took more than its share is not read on until it has rested.

The time that is charged is the processor's. It decides when something is read, and never what is judged.
"""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from typing import TypeVar, TypeVarTuple, Unpack

from oracle_server.process.garbage import collecting

FREE = 0.001
"""Seconds that a session may take before it rests."""
ACTIVE = 1.0
"""Seconds for which a session counts as active after it took some time."""
LONGEST = 10.0
"""Seconds after which it is read on in any case."""
_MOST = 3
"""It rests this many times what it took where at least as many others are active: a quarter of the time is its own."""
_EACH, _RARE = 2, 200
"""What a piece takes beyond `FREE` keeps each of the others waiting: it rests so many times that for each of them, so
many times at most. Beside a hundred it is half a percent of the time, and 99 % of their events do not meet it.
"""
_SAVED = 6.0
"""Seconds of such rest that count as made up for in advance: a dear piece now and then is no reason to rest."""

Args = TypeVarTuple("Args")
T = TypeVar("T")


def spent() -> float:
    """The processor's seconds of this thread, without what full garbage collections took, which are nobody's."""
    return time.thread_time() - collecting()


class Shares:
    """The shares of all sessions."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, spent: Callable[[], float] = spent) -> None:
        """Begin without any; `clock` and `spent` are in seconds."""
        self.clock, self.spent = clock, spent
        self._active: OrderedDict[Share, float] = OrderedDict()
        """When each was last active, the latest one last."""

    def share(self) -> Share:
        """The share of a new session."""
        return Share(self)

    def touch(self, share: Share, now: float) -> None:
        """Note that a session is active."""
        self._active[share] = now
        self._active.move_to_end(share)

    def leave(self, share: Share) -> None:
        """Note that a session is not active any more."""
        self._active.pop(share, None)

    def others(self, share: Share, now: float) -> int:
        """How many sessions are active beside one."""
        active = self._active
        while active and next(iter(active.values())) <= now - ACTIVE:
            active.popitem(last=False)
        return len(active) - (share in active)


class Share:
    """What one session takes of the event loop's time."""

    def __init__(self, shares: Shares) -> None:
        self._shares = shares
        self._used = 0.0
        """Seconds that it took and did not make up for."""
        self._owed = -_SAVED
        """Seconds for which it should rest for what could not be divided; below 0, what it has saved up."""
        self._at = self._until = 0.0
        self._inner = 0.0
        self._began: float | None = None
        """What the processor had spent when its present turn began; None between two."""
        self._awaited = True

    def run(self, work: Callable[[Unpack[Args]], T], *args: *Args) -> T:
        """Do some of the session's work now, and charge it, also where it fails."""
        return self._run(_RARE, work, *args)

    def run_for_server(self, work: Callable[[Unpack[Args]], T], *args: *Args) -> T:
        """Do what the server itself wants of the session: a single large piece is charged like many small ones."""
        return self._run(0, work, *args)

    def set_awaited(self, *, awaited: bool) -> None:
        """Whether anybody waits for what the session does: for one that has no monitors others need not rest."""
        self._awaited = awaited
        if not awaited:
            self._shares.leave(self)

    def is_over(self) -> bool:
        """Whether its present turn has taken what it may take at once."""
        return self._began is not None and self._shares.spent() - self._began > FREE

    @property
    def rest(self) -> float:
        """For how many seconds it should not be read; 0 where it is alone."""
        if not self._until:
            return 0.0
        now = self._shares.clock()
        left = self._until - now
        if left <= 0 or not self._shares.others(self, now):
            self._until = 0.0
            return 0.0
        return left

    async def rested(self, sleep: Callable[[float], Awaitable[object]] = asyncio.sleep) -> None:
        """Wait until it may be read on."""
        while rest := self.rest:
            await sleep(rest)

    def _run(self, rare: int, work: Callable[[Unpack[Args]], T], *args: *Args) -> T:
        outer, self._inner, begin, outermost = self._inner, 0.0, self._shares.spent(), self._began is None
        self._began = begin if outermost else self._began
        try:
            return work(*args)
        finally:
            self._began = None if outermost else self._began
            took = self._shares.spent() - begin
            self._charge(took - self._inner, rare)
            self._inner = outer + took

    def _charge(self, took: float, rare: int) -> None:
        shares, now = self._shares, self._shares.clock()
        others = shares.others(self, now - took)  # none of them could do anything meanwhile
        if self._awaited:
            shares.touch(self, now)
        passed, self._at = now - self._at, now
        self._owed = max(-_SAVED, self._owed - passed)
        if not others:
            self._used = self._until = 0.0
            return
        fair = min(_MOST, others)
        self._used = max(0.0, self._used - passed / (1 + fair)) + took
        self._owed = min(LONGEST, self._owed + min(rare, _EACH * others) * max(0.0, took - FREE))
        rest = self._owed
        if self._used > FREE:
            rest, self._used = max(rest, fair * self._used), 0.0
        if rest > 0:
            self._until = max(self._until, now + min(rest, LONGEST))
