"""What PostgreSQL costs beside SQLite, and how soon a monitor is attached again once its server was killed.

python benchmarks/fleet.py [--url postgresql://USER@HOST/EMPTY_DATABASE] [--rounds 5] [--kills 5] [--lease 3]

Without `--url` a PostgreSQL of Debian's packages is started for it. *Decision*: one at a time, 5 ms apart, in turns
over both histories. *Batches*: events in frames of 256, from the first one until the last one is acked, in turns; the
best counts. *Attached again*: two servers share the database, an adapter's link that knows both sends 1,000 events a
second, and the one that has its session is killed by SIGKILL.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import tempfile
import threading
import time
from pathlib import Path
from statistics import median

from database import database
from oracle_adapter import Link
from served import Server, event, hello, percentile, until, until_acked

ASKS = 400
"""Decisions a round."""
PAUSE = 0.005
EVENTS, BATCH = 20_480, 256
RATE = 1000
BEFORE = 3.0
"""Seconds of events before a server is killed."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--lease", type=float, default=3.0)
    asked = parser.parse_args()
    with database(asked.url) as url, tempfile.TemporaryDirectory() as name:
        asyncio.run(compare(Path(name), url, asked.rounds))
        waits = [killed(Path(name) / f"kill{number}", url, asked.lease, number) for number in range(asked.kills)]
    if waits:
        told = f"median {median(waits):.2f} s, at the most {max(waits):.2f} s"
        print(f"attached again after kill -9: {told}, which is the lease and {max(waits) - asked.lease:.2f} s")


async def compare(folder: Path, url: str, rounds: int) -> None:
    """Print decisions and batches over both histories, and their ratios."""
    places = {"SQLite": {}, "PostgreSQL": {"ORACLE_HISTORY": url, "ORACLE_NODE": "compared"}}
    times: dict[str, list[float]] = {name: [] for name in places}
    rates: dict[str, list[float]] = {name: [] for name in places}
    servers: dict[str, Server] = {}
    try:
        for name, settings in places.items():
            (folder / name).mkdir()
            servers[name] = Server(folder / name, ORACLE_MAX_RATE="0", **settings)
        for number in range(rounds):
            for name, server in servers.items():
                times[name] += await decisions(server, f"asked{number}")
                rates[name].append(await acked(server, f"batches{number}"))
    finally:
        for server in servers.values():
            server.stop()
    half = {name: percentile(found, 50) for name, found in times.items()}
    best = {name: max(found) for name, found in rates.items()}
    for name in places:
        decided = f"decision median {half[name]:.3f} ms, 99 % {percentile(times[name], 99):.2f} ms"
        print(f"{name:10}: {decided}; batches {best[name]:,.0f} events acked a second")
    print(f"PostgreSQL: decisions {half['PostgreSQL'] / half['SQLite']:.2f} of SQLite's time", end=", ")
    print(f"batches {best['PostgreSQL'] / best['SQLite']:.2f} of its events a second")


async def decisions(server: Server, session: str) -> list[float]:
    """The times from questions to their decisions, in ms."""
    times = []
    async with server.attach() as socket:
        await socket.send(json.dumps(hello(session)))
        await until(socket, "attached")
        for seq in range(1, ASKS + 1):
            begin = time.perf_counter()
            await socket.send(json.dumps(event(seq) | {"ask": True}))
            await until(socket, "decision")
            times.append((time.perf_counter() - begin) * 1000)
            await asyncio.sleep(PAUSE)
    return times


async def acked(server: Server, session: str) -> float:
    """Events a second that are sent in batches, until the last one is acked."""
    async with server.attach() as socket:
        await socket.send(json.dumps(hello(session)))
        await until(socket, "attached")
        frames = [
            json.dumps({"type": "events", "events": [event(seq) for seq in range(first, first + BATCH)]})
            for first in range(1, EVENTS + 1, BATCH)
        ]
        begin = time.perf_counter()
        reading = asyncio.create_task(until_acked(socket, EVENTS))
        for frame in frames:
            await socket.send(frame)
        await reading
        return EVENTS / (time.perf_counter() - begin)


def killed(folder: Path, url: str, lease: float, number: int) -> float:
    """Seconds from the end of the server that has a session until its monitor is attached to another one."""
    servers = []
    for name in ("first", "second"):
        (folder / name).mkdir(parents=True)
        node = {"ORACLE_NODE": f"{name}{number}", "ORACLE_LEASE": str(lease)}
        servers.append(Server(folder / name, ORACLE_HISTORY=url, ORACLE_MAX_RATE="0", **node))
    attached = threading.Event()

    def stands(state: str, _: str) -> None:
        if state == "attached":
            attached.set()

    urls = ",".join(f"http://127.0.0.1:{server.port}" for server in servers)
    try:
        with Link(urls, "m", spec="soak", session=f"killed{number}", on_state=stands, on_error=lambda _: None) as link:
            link.wait_attached(60)
            send(link, BEFORE, threading.Event())
            attached.clear()
            servers[0].process.kill()
            begin = time.perf_counter()
            going_on = threading.Thread(target=send, args=(link, 60.0, attached))
            going_on.start()
            assert attached.wait(60), "it was not attached again within a minute"
            took = time.perf_counter() - begin
            going_on.join()
    finally:
        for server in servers:
            server.stop()
    return took


def send(link: Link, seconds: float, ended: threading.Event) -> None:
    """Send events at their rate for so long, or until something has happened."""
    begin = time.perf_counter()
    for i in range(int(seconds * RATE)):
        if ended.wait(max(0.0, begin + i / RATE - time.perf_counter())):
            return
        link.send("/a", "topic", time.time_ns(), {"v": 1})


if __name__ == "__main__":
    main()
