"""Threads that read for clients: few, so that decisions do not wait for the interpreter, and shared fairly.

A client has a few of them at most, and all clients take turns, however many requests each has made. What is done at a
turn is bounded: a page of records, not all of them.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")

THREADS = 2
"""Threads that read for all clients."""
SHARE = 1
"""Of these at most for one client."""
_SERVER = ""
_client: ContextVar[str] = ContextVar("client", default=_SERVER)


@contextmanager
def reading_for(client: str = _SERVER) -> Iterator[None]:
    """Within this, and in tasks that begin in it, what is read is read for a client; without one for the server."""
    token = _client.set(client)
    try:
        yield
    finally:
        _client.reset(token)


def reader() -> str:
    """The client for whom is read now."""
    return _client.get()


class _Read(NamedTuple):
    client: str
    work: Callable[[], Any]
    answer: asyncio.Future[Any]


class Readers:
    """Threads, and those who wait for one of them: to be used from one event loop's thread."""

    def __init__(self, threads: int = THREADS, share: int = SHARE, name: str = "history reader") -> None:
        """Begin with some threads, of which one client has a share at most."""
        self._pool = ThreadPoolExecutor(threads, name)
        self._free, self._share = threads, share
        self._waiting: dict[str, deque[_Read]] = {}
        """By client, the one first whose turn is next."""
        self._busy: Counter[str] = Counter()

    @property
    def waiting(self) -> int:
        """How much waits for its turn."""
        return sum(map(len, self._waiting.values()))

    def start(self, work: Callable[[], T]) -> asyncio.Future[T]:
        """Work in a thread once it is its client's turn; returns what comes of it.

        What is cancelled before is not begun. What has begun keeps its thread until it ends.
        """
        read = _Read(_client.get(), work, asyncio.get_running_loop().create_future())
        read.answer.add_done_callback(lambda answer: self._withdraw(read) if answer.cancelled() else None)
        self._waiting.setdefault(read.client, deque()).append(read)
        self._begin()
        return read.answer

    def close(self) -> None:
        """End the threads, once they have done what they do."""
        self._pool.shutdown(cancel_futures=True)

    def _begin(self) -> None:
        while self._free:
            client = next((name for name in self._waiting if self._busy[name] < self._share), None)
            if client is None:
                return
            reads = self._waiting.pop(client)
            read = reads.popleft()
            if reads:
                self._waiting[client] = reads  # behind all others
            if not read.answer.done():
                self._free -= 1
                self._busy[client] += 1
                done = asyncio.get_running_loop().run_in_executor(self._pool, read.work)
                done.add_done_callback(lambda done, read=read: self._ended(read, done))  # type: ignore[misc]

    def _ended(self, read: _Read, done: asyncio.Future[Any]) -> None:
        self._free += 1
        self._busy[read.client] -= 1
        if not self._busy[read.client]:
            del self._busy[read.client]
        error = None if done.cancelled() else done.exception()
        if read.answer.done():  # nobody waits for it any more
            pass
        elif done.cancelled():
            read.answer.cancel()
        elif error is not None:
            read.answer.set_exception(error)
        else:
            read.answer.set_result(done.result())
        self._begin()

    def _withdraw(self, read: _Read) -> None:
        reads = self._waiting.get(read.client)
        if reads is not None and read in reads:
            reads.remove(read)
            if not reads:
                del self._waiting[read.client]
