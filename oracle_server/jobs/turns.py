"""Whose turn it is to be judged: one after the other, and beside one that takes long the next ones all the same."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator

LONG = 600.0
"""Seconds after which one that is being judged goes on beside the others, and the next one begins."""


class Turns:
    """Gives turns to those who wait, in the order in which they came."""

    def __init__(self, long: float = LONG) -> None:
        """`long`: seconds after which one takes long."""
        self._long = long
        self._turn, self._beside = asyncio.Lock(), asyncio.Lock()

    @contextlib.asynccontextmanager
    async def one(self) -> AsyncGenerator[None, None]:
        """Wait for a turn, and have it until the end; where that takes long another one gets it meanwhile.

        Of those that take long one at a time goes on beside the others, so that never more than two are judged at once.
        """
        await self._turn.acquire()
        held = [self._turn]
        moving = asyncio.create_task(self._move(held))
        try:
            yield
        finally:
            moving.cancel()
            held.pop().release()

    async def _move(self, held: list[asyncio.Lock]) -> None:
        """Give the turn on once it has taken long, and no other such one goes on."""
        await asyncio.sleep(self._long)
        await self._beside.acquire()
        held.pop().release()
        held.append(self._beside)
