"""How far monitors may go in a trace, so that there is something under way whenever something happens."""

from __future__ import annotations

import asyncio
from typing import Any


class Pace:
    """Events up to a stamp (ns) may be sent; it is moved on, never back."""

    def __init__(self, stamp: int) -> None:
        self._stamp = stamp
        self._moved = asyncio.Event()

    def allows(self, events: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Those of some events that may be sent."""
        return [event for event in events if event["stamp"] <= self._stamp]

    async def reaches(self, stamp: int) -> None:
        """Wait until an event with this stamp may be sent."""
        while self._stamp < stamp:
            await self._moved.wait()

    def move_on(self, stamp: int) -> None:
        """Allow events up to a stamp."""
        self._stamp = stamp
        self._moved.set()
        self._moved = asyncio.Event()
