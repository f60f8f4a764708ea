"""How long a fleet waits that attaches at once: each robot opens a session of six properties.

    python benchmarks/crowd.py [--robots 1000] [--rounds 3]

The bare baseline is an echo over the same stack, which answers each robot's first frame with itself. Robots are
connections of this process, which shares the machine with the server; each round begins with a fresh server.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import resource
import tempfile
import time
from contextlib import AsyncExitStack
from pathlib import Path
from statistics import median
from typing import NamedTuple

from apart import Server, echo, oracle
from lines import Line, table
from served import hello
from websockets.asyncio.client import connect

SPECS = Path(__file__).resolve().parents[1] / "specs"
GOAL = 10.0
"""Seconds within which 1,000 robots are to be attached."""


class Taken(NamedTuple):
    """Seconds until the last robot was answered, and those that the server's processor spent."""

    wall: float
    cpu: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # each robot's socket is a file of both processes
    rounds = [one_round(args.robots) for _ in range(args.rounds)]
    print(table([_line("until the last answer", rounds, 0), _line("the server's processor", rounds, 1)]))
    within = median(attached.wall for attached, _ in rounds)
    said = "" if args.robots != 1000 else f"; goal: {GOAL:.0f} s at most: {'met' if within <= GOAL else 'MISSED'}"
    print(f"{args.robots} robots attached within {within:.2f} s (median of {args.rounds}){said}")


def _line(what: str, rounds: list[tuple[Taken, Taken]], number: int) -> Line:
    ours, bare = (median(each[which][number] for each in rounds) for which in (0, 1))
    return Line(what, "ms", 1e3 * ours, 1e3 * bare)


def one_round(robots: int) -> tuple[Taken, Taken]:
    """The oracle's figures and the echo's, each of a fresh server."""
    with tempfile.TemporaryDirectory() as folder, oracle(SPECS, Path(folder)) as server:
        attached = asyncio.run(all_answered(server, robots))
    with echo() as server:
        return attached, asyncio.run(all_answered(server, robots))


async def all_answered(server: Server, robots: int) -> Taken:
    """Connect all robots at once, and wait until each has its answer."""
    spent, begin = server.cpu, time.perf_counter()
    async with AsyncExitStack() as stack:
        await asyncio.gather(*(_answered(stack, server.url, robot) for robot in range(robots)))
        return Taken(time.perf_counter() - begin, server.cpu - spent)


async def _answered(stack: AsyncExitStack, url: str, robot: int) -> None:
    dialled = connect(url, compression=None, proxy=None, ping_interval=None, open_timeout=60)
    socket = await stack.enter_async_context(dialled)
    await socket.send(json.dumps(hello(f"robot{robot}", "battery_uav")))
    answer = json.loads(await socket.recv())
    assert answer["type"] in ("attached", "attach"), answer


if __name__ == "__main__":
    main()
