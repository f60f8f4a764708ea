"""One that takes long holds nobody up, and no more than two are judged at once."""

from __future__ import annotations

import asyncio
import math

import pytest

from oracle_server.jobs.turns import Turns


class Judged:
    """One that is judged until it is ended."""

    def __init__(self, turns: Turns) -> None:
        self.begun, self._end = asyncio.Event(), asyncio.Event()
        self._turns = turns
        self.task = asyncio.create_task(self._run())

    async def _run(self) -> None:
        async with self._turns.one():
            self.begun.set()
            await self._end.wait()

    async def end(self) -> None:
        """End, and return once that is over."""
        self._end.set()
        await self.task


async def until_nothing_moves() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


@pytest.mark.parametrize("long", [0.0, math.inf])
async def test_beside_one_that_takes_long_the_next_ones_are_judged(long: float) -> None:
    turns = Turns(long)
    all_of_them = [Judged(turns) for _ in range(4)]
    for ended in range(4):
        await until_nothing_moves()
        at_once = 2 if long == 0 else 1
        begun = [one.begun.is_set() for one in all_of_them]
        assert begun == [at < ended + at_once for at in range(4)]
        await all_of_them[ended].end()


async def test_one_that_is_cancelled_leaves_its_turn_to_the_next() -> None:
    turns = Turns(0)
    first, second, third, fourth = (Judged(turns) for _ in range(4))
    await until_nothing_moves()
    first.task.cancel()  # which goes on beside the others
    await third.begun.wait()
    third.task.cancel()
    await fourth.begun.wait()
    await asyncio.gather(second.end(), fourth.end())
