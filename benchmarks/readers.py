"""What decisions and attaches take beside clients that read all of a history, again and again.

python benchmarks/readers.py [--clients 12] [--seconds 10]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import tempfile
import time
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from urllib.request import urlopen

from served import Server, event, hello, percentile, until

EVENTS = 40_000
"""In the history that is read."""
BATCH = 500
PAUSE = 0.005
"""Seconds between two questions for a decision; twenty times as long between two attaches."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clients", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=10)
    asyncio.run(measure(**vars(parser.parse_args())))


async def measure(clients: int, seconds: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder), ORACLE_MAX_RATE="0")
        pages = multiprocessing.Value("l", 0)
        readers = [multiprocessing.Process(target=read, args=(server.port, i, pages)) for i in range(clients)]
        try:
            await fill(server)
            await compared(server, "alone", seconds)
            for reader in readers:
                reader.start()
            before = pages.value
            await compared(server, f"beside {clients} clients", seconds)
            print(f"  they read {(pages.value - before) / seconds:.0f} pages a second")
        finally:
            for reader in readers:
                if reader.pid is not None:
                    reader.terminate()
            server.stop()


def read(port: int, number: int, pages: Synchronized[int]) -> None:
    """Read all verdicts, a page after the other; each fourth client downloads the trace instead."""
    session = f"http://127.0.0.1:{port}/api/v1/sessions/full"
    while True:
        if number % 4 == 3:
            with urlopen(f"{session}/trace") as trace:
                while trace.read(2**18):
                    pass
            continue
        after: int | None = 0
        while after is not None:
            with urlopen(f"{session}/verdicts?limit=1000&after={after}") as page:
                after = json.load(page)["next"]
            with pages.get_lock():
                pages.value += 1


async def fill(server: Server) -> None:
    async with server.attach() as socket:
        await socket.send(json.dumps(hello("full")))
        await until(socket, "attached")
        for first in range(1, EVENTS, BATCH):
            events = [event(seq) for seq in range(first, first + BATCH)]
            await socket.send(json.dumps({"type": "events", "events": events}))
            while (await until(socket, "ack"))["upto"] < first + BATCH - 1:
                pass


async def compared(server: Server, what: str, seconds: float) -> None:
    end = time.perf_counter() + seconds
    asked, opened = await asyncio.gather(decisions(server, what, end), attaches(server, what, end))
    print(
        f"{what}: a decision {percentile(asked, 50):.2f} ms, 99 % {percentile(asked, 99):.2f} ms; "
        f"an attach to a new session {percentile(opened, 50):.1f} ms, at most {max(opened):.1f} ms"
    )


async def decisions(server: Server, name: str, end: float) -> list[float]:
    """The times from an ask to its decision, in ms."""
    times: list[float] = []
    async with server.attach() as socket:
        await socket.send(json.dumps(hello(f"asking.{len(name)}")))
        seq = (await until(socket, "attached"))["next"]
        while (begin := time.perf_counter()) < end:
            await socket.send(json.dumps(event(seq + len(times)) | {"ask": True}))
            await until(socket, "decision")
            times.append((time.perf_counter() - begin) * 1000)
            await asyncio.sleep(PAUSE)
    return times


async def attaches(server: Server, name: str, end: float) -> list[float]:
    """The times from a connect to `attached`, in ms."""
    times: list[float] = []
    while (begin := time.perf_counter()) < end:
        async with server.attach() as socket:
            await socket.send(json.dumps(hello(f"new.{len(name)}.{len(times)}")))
            await until(socket, "attached")
        times.append((time.perf_counter() - begin) * 1000)
        await asyncio.sleep(20 * PAUSE)
    return times


if __name__ == "__main__":
    main()
