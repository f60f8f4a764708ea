"""Who reads an answer slowly gets all of it; who reads nothing is cut off. No time passes here but what is told."""

from __future__ import annotations

import asyncio
import heapq
import itertools
import sys
from collections.abc import Callable
from typing import Any, cast

import pytest
import uvicorn
from uvicorn.server import ServerState

from oracle_server.edge.transport import READ_WITHIN, HttpTransport


async def app(scope: object, receive: object, send: object) -> None: ...


class Time:
    """A loop's time, which goes on as it is told to."""

    def __init__(self) -> None:
        self.now, self._due, self._numbers = 1000.0, list[tuple[float, int, Callable[[], object]]](), itertools.count()
        self._cancelled = set[int]()

    def time(self) -> float:
        return self.now

    def call_later(self, within: float, work: Callable[..., object], *args: object) -> Any:
        number = next(self._numbers)
        heapq.heappush(self._due, (self.now + within, number, lambda: work(*args)))

        class Handle:
            def cancel(_) -> None:  # noqa: N805
                self._cancelled.add(number)

        return Handle()

    def pass_(self, seconds: float) -> None:
        until = self.now + seconds
        while self._due and self._due[0][0] <= until:
            self.now, number, work = heapq.heappop(self._due)
            if number not in self._cancelled:
                work()
        self.now = until


class Client:
    """A connection as its transport shows it: what waits, and what the client's system has received."""

    def __init__(self, *, tells: bool = True) -> None:
        self.waiting, self.received, self.tells, self.aborted = 10**6, 0, tells, False

    def get_extra_info(self, _: str) -> Client:
        return self

    def getsockopt(self, _: int, __: int, size: int) -> bytes:
        if not self.tells:
            raise OSError("no such option")
        return bytes(120) + self.received.to_bytes(8, sys.byteorder) + bytes(size - 128)

    def get_write_buffer_size(self) -> int:
        return self.waiting

    def abort(self) -> None:
        self.aborted = True


def paused(client: Client) -> tuple[HttpTransport, Time]:
    config = uvicorn.Config(app, ws="none")
    config.load()
    time = Time()
    made = HttpTransport(config, ServerState(), {}, cast("asyncio.AbstractEventLoop", time))
    made.transport = cast("asyncio.Transport", client)
    made.flow = cast("Any", type("Flow", (), {"pause_writing": lambda _: None, "resume_writing": lambda _: None})())
    made.pause_writing()
    return made, time


@pytest.mark.parametrize("tells", [True, False])
def test_who_reads_all_the_time_is_never_cut_off(tells: bool) -> None:
    client = Client(tells=tells)
    _, time = paused(client)
    for _ in range(100):
        time.pass_(READ_WITHIN / 2)
        client.received += 1000
        client.waiting -= 0 if tells else 1000
    assert not client.aborted


@pytest.mark.parametrize("tells", [True, False])
def test_who_reads_nothing_is_cut_off(tells: bool) -> None:
    client = Client(tells=tells)
    _, time = paused(client)
    time.pass_(READ_WITHIN * 0.9)
    assert not client.aborted
    time.pass_(READ_WITHIN * 0.2)
    assert client.aborted


def test_who_stops_reading_is_cut_off() -> None:
    client = Client()
    _, time = paused(client)
    for _ in range(10):
        client.received += 1000
        time.pass_(READ_WITHIN / 2)
    assert not client.aborted
    time.pass_(READ_WITHIN * 1.1)
    assert client.aborted


def test_nobody_is_looked_at_whose_answer_is_read() -> None:
    client = Client()
    made, time = paused(client)
    made.resume_writing()
    time.pass_(READ_WITHIN * 3)
    assert not client.aborted
