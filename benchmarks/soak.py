"""What a server's memory does over many sessions and reconnects, and whether a reader that stops slows the others.

python benchmarks/soak.py [--sessions 1000] [--reconnects 10000] [--rounds 3] [--only sessions|reconnects|sse]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import socket
import tempfile
import time
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path

from served import Server, event, hello, percentile, talk, until
from websockets.asyncio.client import ClientConnection

AT_ONCE = 50
SECONDS = 12
"""For how long decisions are asked for in a round, alone and beside a reader that stops: longer than it is kept."""
FIRST = 1_000
"""Of these the first are told apart: while the reader is served what it will not read."""
FULL = 20_000
"""Events in the history that the reader asks for and does not read: several MB."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=1_000)
    parser.add_argument("--reconnects", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", choices=("sessions", "reconnects", "sse"))
    asyncio.run(soak(**vars(parser.parse_args())))


async def soak(sessions: int, reconnects: int, rounds: int, only: str | None) -> None:
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder))
        try:
            if only in (None, "sessions"):
                await sessions_opened(server, sessions)
            if only in (None, "reconnects"):
                await reconnected(server, reconnects)
            if only in (None, "sse"):
                await beside_a_reader_that_stops(server, rounds)
        finally:
            server.stop()


async def sessions_opened(server: Server, count: int) -> None:
    """Open sessions with a monitor each, and let each say ten things."""
    before, begin = server.memory, time.monotonic()
    async with AsyncExitStack() as stack:
        for start in range(0, count, AT_ONCE):
            names = [f"s{i}" for i in range(start, min(start + AT_ONCE, count))]
            sockets = [await stack.enter_async_context(server.attach()) for _ in names]
            await asyncio.gather(*(talk(each, name, 10) for each, name in zip(sockets, names, strict=True)))
        took, after = time.monotonic() - begin, server.memory
        print(f"{count} open sessions, a monitor and ten events each: {took:.1f} s, {server.files} open files")
        print(f"  memory {before:.0f} MB -> {after:.0f} MB, {(after - before) * 1024 / count:.0f} kB a session")


async def reconnected(server: Server, count: int) -> None:
    """Come back again and again, each second time without a word of leaving, and with an event each time."""
    print(f"{count} reconnects over {AT_ONCE} sessions")
    begin, done, shown = time.monotonic(), 0, 10

    async def come_back(session: str) -> None:
        nonlocal done
        while done < count:
            done += 1
            async with server.attach() as socket:
                await talk(socket, session, 1)
                if done % 2:
                    socket.transport.abort()

    tasks = asyncio.gather(*(come_back(f"s{i}") for i in range(AT_ONCE)))
    for step in range(shown + 1):
        while done < count * step // shown and not tasks.done():
            await asyncio.sleep(0.05)
        print(f"  after {done:6}: {server.memory:6.1f} MB, {server.files:5} open files")
    await tasks
    print(f"  {count / (time.monotonic() - begin):.0f} a second")


async def beside_a_reader_that_stops(server: Server, rounds: int) -> None:
    """Ask for decisions in turns without and beside a reader of the stream that has stopped to read."""
    async with server.attach() as filling:
        await talk(filling, "full", FULL)
    alone: list[list[float]] = []
    beside: list[list[float]] = []
    async with server.attach() as asking:
        await asking.send(json.dumps(hello("asking")))
        following = (await until(asking, "attached"))["next"]
        following += len(await asked(asking, following, 1))  # so that all is warm
        for number in range(1, rounds + 1):
            alone.append(await asked(asking, following, SECONDS))
            following += len(alone[-1])
            with reader_that_stops(server):
                beside.append(await asked(asking, following, SECONDS))
            following += len(beside[-1])
            print(f"round {number}: {compared(alone[-1], beside[-1])}")
    for what, part in (("all decisions, alone and beside it", None), (f"the first {FIRST} since it came", FIRST)):
        kinds = [[time for times in kind for time in times[:part]] for kind in (alone, beside)]
        print(f"{what}: {compared(*kinds)}")


def compared(alone: list[float], beside: list[float]) -> str:
    """The times of decisions alone and beside the reader, in words."""
    medians = [percentile(times, 50) for times in (alone, beside)]
    worst = [percentile(times, 99) for times in (alone, beside)]
    return (
        f"median {medians[0]:.2f} and {medians[1]:.2f} ms, 99 % {worst[0]:.2f} and {worst[1]:.2f} ms, "
        f"{worst[1] / worst[0]:.2f} times as long"
    )


@contextmanager
def reader_that_stops(server: Server) -> Iterator[None]:
    """A client that asks for the stream of a long history, and reads nothing of it."""
    with socket.socket() as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lazy.connect(("127.0.0.1", server.port))
        lazy.send(f"GET /api/v1/sessions/full/stream HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        yield


async def asked(socket_: ClientConnection, first: int, seconds: float) -> list[float]:
    """The times from an ask to its decision, in ms."""
    times: list[float] = []
    end = time.perf_counter() + seconds
    while (begin := time.perf_counter()) < end:
        await socket_.send(json.dumps(event(first + len(times)) | {"ask": True}))
        await until(socket_, "decision")
        times.append((time.perf_counter() - begin) * 1000)
    return times


if __name__ == "__main__":
    main()
