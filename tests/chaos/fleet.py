"""Several real servers over one history: monitors ask one after the other, and those that end are started again."""

from __future__ import annotations

import asyncio
import itertools
from typing import Any, Self

import httpx

from tests.chaos.served import PATIENCE, Ended, Served

Frame = dict[str, Any]


class Fleet:
    """Servers by their names; what a `Link` needs of a server, for one that may be at any of them."""

    def __init__(self, nodes: dict[str, Served]) -> None:
        self.nodes = nodes
        self.up = asyncio.Event()
        self.restarts = asyncio.Event()
        """Whether one that has ended is started again at once: back within its lease it goes on itself."""
        self.restarts.set()
        self._turns = itertools.cycle(nodes.values())
        self._reviving: list[asyncio.Task[None]] = []

    @property
    def attach_url(self) -> str:
        """Where monitors attach: at the next server each time."""
        return next(self._turns).attach_url

    async def records(self, session: str) -> list[list[Frame]]:
        """All of a session's history, as each server tells it, once it is there to be asked."""
        async with asyncio.timeout(3 * PATIENCE):  # each may have to be started first, and what answers in it
            return await asyncio.gather(*(self._records(node, session) for node in self.nodes.values()))

    async def _records(self, node: Served, session: str) -> list[Frame]:
        while True:
            try:
                return await node.records(session)
            except httpx.TransportError:
                await node.up.wait()  # it is being started again, once its end is noticed

    async def __aenter__(self) -> Self:
        """Start all."""
        await asyncio.gather(*(node.start() for node in self.nodes.values()))
        self._reviving = [asyncio.create_task(self._revive(node)) for node in self.nodes.values()]
        self.up.set()
        return self

    async def __aexit__(self, failed: object, *_: object) -> None:
        """End all, however it can be done; of a test that fails, show what they said last."""
        if failed:
            for name, node in self.nodes.items():
                said = [line for line in node.log if not line["event"].startswith("violation")]
                print(*((name, line) for line in said[-50:]), sep="\n")
        for task in self._reviving:
            task.cancel()
        await asyncio.gather(*self._reviving, return_exceptions=True)
        for node in self.nodes.values():
            await node.close()

    async def _revive(self, node: Served) -> None:
        while True:
            await node.ended()
            node.up.clear()
            await self.restarts.wait()
            try:
                await node.start()
            except Ended:  # its lease had not run out for others to see; it is tried again
                continue
