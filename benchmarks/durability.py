"""What `durability: normal` saves: both settings in turns, on the same disk.

python benchmarks/durability.py [--rounds 5] [--events 20000] [--folder .]

*Acked a second*: events in batches of 64, until the last one is acked. *Ack*: from one event to its ack, one at a time.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import tempfile
import time
from pathlib import Path

from served import Server, event, hello, percentile, until, until_acked

BATCH = 64
ONE_BY_ONE = 200


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--events", type=int, default=20_000)
    parser.add_argument("--folder", type=Path, default=Path(), help="on the disk that is to be measured")
    asyncio.run(measure(**vars(parser.parse_args())))


async def measure(rounds: int, events: int, folder: Path) -> None:
    rates: dict[str, list[float]] = {"full": [], "normal": []}
    waits: dict[str, list[float]] = {"full": [], "normal": []}
    with tempfile.TemporaryDirectory(dir=folder) as own:
        servers: dict[str, Server] = {}
        try:
            for name in rates:
                (Path(own) / name).mkdir()
                servers[name] = Server(Path(own) / name, ORACLE_DURABILITY=name, ORACLE_MAX_RATE="0")
            for number in range(rounds):
                for name, server in servers.items():
                    rate, times = await round_of(server, f"s{number}", events)
                    rates[name].append(rate)
                    waits[name] += times
        finally:
            for server in servers.values():
                server.stop()
    for name, found in rates.items():
        told = f"median {percentile(waits[name], 50):.1f} ms, 99 % {percentile(waits[name], 99):.1f} ms"
        print(f"{name:6}: {max(found):6.0f} acked a second; ack {told}")
    saved = percentile(waits["full"], 50) / percentile(waits["normal"], 50)
    print(f"normal: {max(rates['normal']) / max(rates['full']):.2f} times as many, acks {saved:.2f} times as soon")


async def round_of(server: Server, session: str, events: int) -> tuple[float, list[float]]:
    """Events acked a second, and the times (ms) from single events to their acks."""
    async with server.attach() as socket:
        await socket.send(json.dumps(hello(session)))
        await until(socket, "attached")
        frames = [
            json.dumps({"type": "events", "events": [event(seq) for seq in range(first, first + BATCH)]})
            for first in range(1, events + 1, BATCH)
        ]
        last = len(frames) * BATCH
        begin = time.perf_counter()
        reading = asyncio.create_task(until_acked(socket, last))
        for frame in frames:
            await socket.send(frame)
        await reading
        rate = last / (time.perf_counter() - begin)
        times = []
        for seq in range(last + 1, last + 1 + ONE_BY_ONE):
            begin = time.perf_counter()
            await socket.send(json.dumps(event(seq)))
            await until_acked(socket, seq)
            times.append((time.perf_counter() - begin) * 1000)
    return rate, times


if __name__ == "__main__":
    main()
