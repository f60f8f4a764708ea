"""Requests that come at once begin one at a turn of the event loop, between which others are served."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

from starlette.types import Message, Receive, Scope, Send

from oracle_server.edge.crowds import Crowds


class Begun:
    """An application that notes at which turn of the event loop each request began."""

    def __init__(self) -> None:
        self.turn = 0
        self.at: dict[int, int] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.at[scope["number"]] = self.turn

    async def count(self) -> None:
        """Count the turns."""
        while True:
            self.turn += 1
            await asyncio.sleep(0)


async def receive() -> Message:
    raise AssertionError


async def send(_: Message) -> None:
    raise AssertionError


async def test_of_many_requests_one_begins_at_a_turn_in_the_order_in_which_they_came() -> None:
    app = Begun()
    crowds, counting = Crowds(app), asyncio.create_task(app.count())

    def requests(numbers: range) -> Iterator[asyncio.Task[None]]:
        for number in numbers:
            yield asyncio.ensure_future(crowds({"type": "http", "number": number}, receive, send))

    coming = [*requests(range(50))]
    coming[3].cancel()
    await asyncio.sleep(0)
    coming[7].cancel()
    await asyncio.wait(coming)
    assert list(app.at) == [number for number in range(50) if number not in (3, 7)]
    assert len({*app.at.values()}) == len(app.at), "each at a turn of its own"
    app.at.clear()
    (alone,) = requests(range(1))
    before = app.turn
    await alone
    assert app.at[0] <= before + 1, "who is alone waits for nobody"
    counting.cancel()
