"""What a server's memory does over many sessions and reconnects, and whether a reader that stops slows the others.

python -m benchmarks.soak [--sessions 1000] [--reconnects 10000]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

SPEC = """
id: soak
streams:
  - topic: /a
    signals: {v: msg.v}
properties:
  - {id: small, formula: 'not {v > 10}'}
  - {id: seen, formula: 'once[:10]{v: 1}'}
"""
AT_ONCE = 50


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=1_000)
    parser.add_argument("--reconnects", type=int, default=10_000)
    asyncio.run(soak(**vars(parser.parse_args())))


async def soak(sessions: int, reconnects: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder))
        try:
            await sessions_opened(server, sessions)
            await reconnected(server, reconnects)
            await beside_a_reader_that_stops(server)
        finally:
            server.process.terminate()
            server.process.wait()


class Server:
    """A server in a process of its own."""

    def __init__(self, folder: Path) -> None:
        specs = folder / "specs"
        specs.mkdir()
        (specs / "soak.yaml").write_text(SPEC)
        command = [sys.executable, "-m", "oracle_server", "serve", "--specs", str(specs), "--port", "0"]
        env = os.environ | {"ORACLE_DATA_DIR": str(folder / "data"), "ORACLE_LOG": "json"}
        self._log = (folder / "log").open("w+")
        self.process = subprocess.Popen(command, env=env, stderr=self._log)
        self.port = 0
        while not self.port:
            time.sleep(0.05)
            self._log.seek(0)
            lines = [json.loads(line) for line in self._log if line.endswith("\n")]
            self.port = next((int(line["url"].rpartition(":")[2]) for line in lines if "url" in line), 0)

    def attach(self) -> connect:
        url = f"ws://127.0.0.1:{self.port}/api/v1/attach"
        return connect(url, compression=None, proxy=None, ping_interval=None, open_timeout=60, max_queue=None)

    @property
    def memory(self) -> float:
        """MB that are resident."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return next(int(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith("VmRSS"))

    @property
    def files(self) -> int:
        """Files and sockets that are open."""
        return len(list(Path(f"/proc/{self.process.pid}/fd").iterdir()))


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


async def talk(socket: ClientConnection, session: str, events: int) -> None:
    await socket.send(json.dumps(hello(session)))
    following = (await until(socket, "attached"))["next"]
    for seq in range(following, following + events):
        await socket.send(json.dumps({"type": "event", "seq": seq, "stream": "/a", "stamp": seq, "data": {"v": 1}}))
    if events:
        while (await until(socket, "ack"))["upto"] < following + events - 1:
            pass


def hello(session: str) -> dict[str, Any]:
    return {"type": "attach", "monitor": "m", "instance": "i", "session": session, "spec": "soak"}


async def until(socket: ClientConnection, kind: str) -> dict[str, Any]:
    while True:
        frame: dict[str, Any] = json.loads(await socket.recv())
        if frame["type"] == kind:
            return frame
        assert frame["type"] != "error", frame


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


async def beside_a_reader_that_stops(server: Server, asks: int = 2_000) -> None:
    """Ask for decisions, first without a reader of the stream that has stopped to read, then beside one."""
    async with server.attach() as filling:
        await talk(filling, "full", 20_000)
    alone = await asked(server, "alone", asks)
    with socket.socket() as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lazy.connect(("127.0.0.1", server.port))
        lazy.send(f"GET /api/v1/sessions/full/stream HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        beside = await asked(server, "beside", asks)
    print(f"decisions alone: median {alone[0]:.2f} ms, 99 % {alone[1]:.2f} ms")
    print(f"beside a reader of the stream that has stopped: median {beside[0]:.2f} ms, 99 % {beside[1]:.2f} ms")


async def asked(server: Server, session: str, count: int) -> tuple[float, float]:
    """The median and the 99th percentile of the time from an ask to its decision, in ms."""
    times = []
    async with server.attach() as socket_:
        await socket_.send(json.dumps(hello(session)))
        await until(socket_, "attached")
        for seq in range(1, count + 1):
            event = {"type": "event", "seq": seq, "stream": "/a", "stamp": seq, "data": {"v": 1}, "ask": True}
            begin = time.perf_counter()
            await socket_.send(json.dumps(event))
            await until(socket_, "decision")
            times.append((time.perf_counter() - begin) * 1000)
    times.sort()
    return times[count // 2], times[count * 99 // 100]


if __name__ == "__main__":
    main()
