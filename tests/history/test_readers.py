"""Threads that read are shared fairly: nobody waits for all that another client asks for."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest

from oracle_server.history.readers import Readers, reading_for
from tests.processes import PATIENCE


class Work:
    """Something to read that takes until it is let go."""

    def __init__(self, readers: Readers, client: str, done: list[str] | None = None, name: str = "") -> None:
        self.begun, self.going = asyncio.Event(), threading.Event()
        self._loop, self._done, self._name = asyncio.get_running_loop(), done, name
        with reading_for(client):
            self.answer = readers.start(self._run)

    def _run(self) -> str:
        self._loop.call_soon_threadsafe(self.begun.set)
        assert self.going.wait(PATIENCE)
        if self._done is not None:
            self._done.append(self._name)
        return self._name


@asynccontextmanager
async def opened(threads: int, share: int) -> AsyncIterator[Callable[..., Work]]:
    """Readers, as a way to begin work; in the end all of it is let go."""
    readers, made = Readers(threads, share), list[Work]()

    def begin(client: str, done: list[str] | None = None, name: str = "") -> Work:
        made.append(Work(readers, client, done, name))
        return made[-1]

    try:
        async with asyncio.timeout(PATIENCE):
            yield begin
            for work in made:
                work.going.set()
            await asyncio.gather(*(work.answer for work in made), return_exceptions=True)
            assert readers.waiting == 0
    finally:
        for work in made:
            work.going.set()
        await asyncio.to_thread(readers.close)


async def test_a_client_that_fills_its_share_keeps_no_other_from_reading() -> None:
    async with opened(threads=2, share=1) as begin:
        greedy = [begin("greedy") for _ in range(50)]
        await greedy[0].begun.wait()
        other = begin("other", name="read")
        await other.begun.wait()
        other.going.set()
        assert await other.answer == "read"
        assert [work.begun.is_set() for work in greedy] == [True] + [False] * 49


async def test_clients_take_turns_however_much_each_wants() -> None:
    async with opened(threads=1, share=1) as begin:
        first = begin("x")
        await first.begun.wait()
        done: list[str] = []
        works = [begin("a", done, f"a{i}") for i in range(3)] + [begin("b", done, f"b{i}") for i in range(3)]
        works += [begin("c", done, "c0")]
        for work in (first, *works):
            work.going.set()
        await asyncio.gather(*(work.answer for work in works))
        assert done == ["a0", "b0", "c0", "a1", "b1", "a2", "b2"]


async def test_what_is_cancelled_before_its_turn_is_not_begun_and_waits_no_more() -> None:
    async with opened(threads=1, share=1) as begin:
        first = begin("a")
        await first.begun.wait()
        gone, after = begin("a"), begin("a", name="after")
        gone.answer.cancel()
        gone.going.set()
        first.going.set()
        after.going.set()
        assert await after.answer == "after"
        assert not gone.begun.is_set()


async def test_a_place_is_free_again_once_what_was_cancelled_there_has_ended() -> None:
    async with opened(threads=1, share=1) as begin:
        gone = begin("a")
        await gone.begun.wait()
        after = begin("b", name="after")
        gone.answer.cancel()
        await asyncio.sleep(0)
        assert not after.begun.is_set()
        gone.going.set()
        await after.begun.wait()
        after.going.set()
        assert await after.answer == "after"


async def test_what_fails_is_told_and_frees_its_place() -> None:
    readers = Readers(1, 1)

    def fails() -> None:
        raise ValueError("no")

    async with asyncio.timeout(PATIENCE):
        for _ in range(3):
            with pytest.raises(ValueError, match="no"):
                await readers.start(fails)
        assert await readers.start(lambda: 7) == 7
    await asyncio.to_thread(readers.close)
