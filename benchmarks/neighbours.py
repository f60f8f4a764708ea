"""What one hostile session costs all others: how long their decisions take alone, beside it, and beside a control.

    python benchmarks/neighbours.py [--sessions 500] [--seconds 12] [--rounds 2] [--only KIND] [--json]

Each session asks for a decision a second, in turns of some seconds: alone; beside a *control*, a process that only
burns the processor as a hostile client may; and beside each kind of hostile client, which sends as fast as it is read.
The time within which 99 % of all asks of a kind were decided is compared with that beside the control; *longest* is
that of any. On two cores the asking client, the server and the hostile one share them, as does the control; where other
programs want them too, the figures say more about these. What can't be divided comes each 10 s at most: in fewer
seconds, whether 99 % of the asks miss it is a matter of chance.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from lines import Line, table
from served import Server, event, hello, percentile, until, until_acked
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

GOAL = 3.0
AT_ONCE = 50
WARM_UP = 3.0
"""Seconds for a hostile client to get going, and to use up what it may do now and then, before anything is measured."""
FULL = 20_000
"""Events in the history that is read again and again."""

SPECS = {
    "formulas": """
id: formulas
streams:
  - topic: /a
    signals: {a: msg.a, b: msg.b}
properties:
  - id: dear
    formula: 'exists[x]. once{a: *x} and {b: 1}'
""",
    "text": """
id: text
streams:
  - topic: /a
    signals: {v: msg.v, long: msg.long}
properties:
  - {id: small, formula: 'not {v > 10} and not {long: "x"}'}
""",
    "list": """
id: list
streams:
  - topic: /a
    signals: {v: msg.v, size: size(msg.list)}
properties:
  - {id: small, formula: 'not {size: 1}'}
""",
    "loop": """
id: loop
streams:
  - topic: /a
    signals: {v: 'msg.list.exists(x, x > 4090)'}
properties:
  - {id: none, formula: 'not {v}'}
""",
}


class Kind(NamedTuple):
    """The spec of a hostile session, its messages by their number, and how many make it as dear as it is."""

    spec: str
    message: Callable[[int], str]
    primed: int = 0


def always(data: Any) -> Callable[[int], str]:
    """The same message whatever its number is."""
    text = json.dumps(data, separators=(",", ":"))
    return lambda _: text


OBJECTS = always({"v": 1, "list": [{"abcdefg": 12_345_678}] * 45_000})
KINDS = {
    "dear formulas": Kind("formulas", lambda seq: f'{{"a":{seq}}}' if seq <= 4_500 else f'{{"b":{seq % 2}}}', 4_500),
    # each tenth event looks at 40,000 values: any more or oftener, and the property is judged no longer
    "formulas dear now and then": Kind(
        "formulas", lambda seq: f'{{"a":{seq}}}' if seq <= 40_000 else f'{{"b":{seq // 10 % 2}}}', 40_000
    ),
    "texts of 900 kB": Kind("text", always({"v": 1, "long": "x" * 900_000})),
    "45,000 objects, unread": Kind("soak", OBJECTS),
    "45,000 objects, counted": Kind("list", OBJECTS),
    "loops over 4,090 values": Kind("loop", always({"list": [*range(4_090)]})),
    "small events": Kind("soak", always({"v": 1})),
}
READERS = "readers of the history"
CONTROL = "control"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=12)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--only", choices=(*KINDS, READERS))
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--hostile", nargs=2, metavar=("KIND", "SESSION"), help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.hostile:
        kind, session = args.hostile
        be_hostile(kind, session, args.port)
        return
    kinds = [args.only] if args.only else [*KINDS, READERS]
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder), SPECS, ORACLE_MAX_RATE="0")
        try:
            times = asyncio.run(measure(server, kinds, args.sessions, args.seconds, args.rounds))
        finally:
            server.stop()
    show(times, as_json=args.json)


async def measure(
    server: Server, kinds: list[str], sessions: int, seconds: float, rounds: int
) -> dict[str, list[float]]:
    """The times (ms) of all decisions, beside each kind."""
    times: dict[str, list[float]] = {kind: [] for kind in ("alone", CONTROL, *kinds)}
    async with AsyncExitStack() as stack:
        asking = []
        for start in range(0, sessions, AT_ONCE):
            sockets = [
                await stack.enter_async_context(server.attach()) for _ in range(start, min(start + AT_ONCE, sessions))
            ]
            asking += await asyncio.gather(*(Asking.begin(s, f"s{start + i}") for i, s in enumerate(sockets)))
        if READERS in kinds:
            await fill(server)
        await ask_all(asking, WARM_UP)
        for _ in range(rounds):
            for kind in times:
                async with hostile(kind, server.port):
                    await ask_all(asking, WARM_UP)
                    times[kind] += await ask_all(asking, seconds)
    return times


class Asking:
    """A session that asks for a decision now and then."""

    def __init__(self, socket: ClientConnection, first: int) -> None:
        self._socket, self._following = socket, first

    @classmethod
    async def begin(cls, socket: ClientConnection, session: str) -> Asking:
        await socket.send(json.dumps(hello(session)))
        return cls(socket, (await until(socket, "attached"))["next"])

    async def ask(self, begin: float, end: float) -> list[float]:
        """The times (ms) from an ask to its decision, of one ask a second."""
        times = []
        while begin < end:
            await asyncio.sleep(begin - time.perf_counter())
            sent = time.perf_counter()
            await self._socket.send(json.dumps(event(self._following) | {"ask": True}))
            await until(self._socket, "decision")
            times.append((time.perf_counter() - sent) * 1000)
            self._following += 1
            begin = max(begin + 1, time.perf_counter())
        return times


async def ask_all(asking: list[Asking], seconds: float) -> list[float]:
    """The times (ms) of all decisions; the sessions ask one after the other."""
    now = time.perf_counter()
    turns = [each.ask(now + i / len(asking), now + seconds) for i, each in enumerate(asking)]
    return [taken for times in await asyncio.gather(*turns) for taken in times]


async def fill(server: Server) -> None:
    """Give the history something to read."""
    async with server.attach() as socket:
        await socket.send(json.dumps(hello("full")))
        await until(socket, "attached")
        for start in range(1, FULL, 500):
            batch = [event(seq) for seq in range(start, start + 500)]
            await socket.send(json.dumps({"type": "events", "events": batch}))
        await until_acked(socket, FULL)


@asynccontextmanager
async def hostile(kind: str, port: int) -> AsyncIterator[None]:
    """A hostile client of a kind in a process of its own.

    Its session is closed after it, for what it had sent would be judged beside the next one.
    """
    if kind == "alone":
        yield
        return
    session = f"hostile-{time.time_ns()}"
    command = [sys.executable, __file__, "--hostile", kind, session, "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        await asyncio.to_thread(process.stdout.readline)
        yield
        if process.poll() is not None:
            raise SystemExit(f"the hostile client '{kind}' has ended by itself")
    finally:
        process.kill()
        process.wait()
        if kind in KINDS:
            await asyncio.to_thread(close, port, session)


def close(port: int, session: str) -> None:
    """Close a session."""
    wanted = urllib.request.Request(f"http://127.0.0.1:{port}/api/v1/sessions/{session}", method="DELETE")
    with urllib.request.urlopen(wanted) as answer:
        answer.read()


def be_hostile(kind: str, session: str, port: int) -> None:
    """Send, or read, as fast as the server lets one."""
    if kind == CONTROL:
        ready()
        while True:
            pass
    if kind == READERS:
        url = f"http://127.0.0.1:{port}/api/v1/sessions/full/verdicts?limit=1000"
        ready()
        while True:
            with urllib.request.urlopen(url) as answer:
                answer.read()
    asyncio.run(flood(KINDS[kind], session, port))


async def flood(kind: Kind, session: str, port: int) -> None:
    async with Server.dial(port) as socket:
        await socket.send(json.dumps(hello(session, kind.spec)))
        await until(socket, "attached")
        for start in range(1, kind.primed, 500):
            batch = ",".join(written(kind, seq) for seq in range(start, start + 500))
            await socket.send(f'{{"type":"events","events":[{batch}]}}')
        if kind.primed:
            await until_acked(socket, kind.primed)
        ready()
        reading = asyncio.create_task(drain(socket))
        for seq in count(kind.primed + 1):
            await socket.send(written(kind, seq))
        await reading


def written(kind: Kind, seq: int) -> str:
    return f'{{"type":"event","seq":{seq},"stream":"/a","stamp":{seq},"data":{kind.message(seq)}}}'


def ready() -> None:
    """Tell that all is as hostile as it will be."""
    print(flush=True)


async def drain(socket: ClientConnection) -> None:
    with suppress(ConnectionClosed):
        async for _ in socket:
            pass


def show(times: dict[str, list[float]], *, as_json: bool) -> None:
    """Print the times beside each kind, and their ratios to those beside the control."""
    control = percentile(times[CONTROL], 99)
    lines = []
    for kind, found in times.items():
        goal = None if kind in ("alone", CONTROL) else GOAL
        lines.append(
            Line(f"{kind}, longest {max(found):.0f} ms", "µs", 1e3 * percentile(found, 99), 1e3 * control, goal)
        )
    if as_json:
        print(json.dumps([asdict(line) | {"ratio": line.ratio, "met": line.met} for line in lines], indent=2))
    else:
        print(table(lines, ("99 % within", "control")))


if __name__ == "__main__":
    main()
