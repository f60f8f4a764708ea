"""The servers that the benchmark of round trips asks: the oracle, and an echo over the same stack, each by itself.

python benchmarks/apart.py     # the echo, which prints its port
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect

_SETTINGS = {"ORACLE_LOG": "json", "ORACLE_MAX_RATE": "0"}


@dataclass(frozen=True)
class Server:
    """A server in a process of its own."""

    url: str
    pid: int

    @property
    def cpu(self) -> float:
        """The CPU seconds that its threads have spent; 0 where there is no /proc."""
        told = [thread.read_text() for thread in Path(f"/proc/{self.pid}/task").glob("*/schedstat")]
        return float(sum(int(text.split()[0]) for text in told)) / 1e9


@contextmanager
def oracle(specs: Path, data: Path, unix: Path | None = None) -> Iterator[Server]:
    """A server with some specs, which listens at a UNIX socket, too, where one is given."""
    command = [sys.executable, "-c", "from oracle_server.cli.commands import main; main()", "serve", "--port", "0"]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("ORACLE_")} | _SETTINGS
    arguments = ["--specs", str(specs), "--data-dir", str(data), *(() if unix is None else ("--unix", str(unix)))]
    with running([*command, *arguments], environment) as process:
        assert process.stderr is not None
        line = json.loads(process.stderr.readline())
        yield Server(line["url"].replace("http", "ws") + "/api/v1/attach", process.pid)


@contextmanager
def echo() -> Iterator[Server]:
    """An echo in a process of its own."""
    with running([sys.executable, __file__], dict(os.environ)) as process:
        assert process.stderr is not None
        yield Server(f"ws://127.0.0.1:{int(process.stderr.readline())}/", process.pid)


@contextmanager
def apart(*servers: int) -> Iterator[None]:
    """Keep this process on one core and others off it, where there are two cores and a system that lets one choose."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    if len(cores) < 2:
        yield
        return
    threads = [int(thread.name) for pid in servers for thread in Path(f"/proc/{pid}/task").iterdir()]
    for thread, its in [(0, cores[:1]), *((thread, cores[1:]) for thread in threads)]:
        os.sched_setaffinity(thread, its)
    try:
        yield
    finally:
        for thread in (0, *threads):
            os.sched_setaffinity(thread, cores)


@contextmanager
def running(command: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def serve_echo() -> None:
    """Send back what comes, over the stack that the server uses."""
    app = FastAPI()

    @app.websocket("/")
    async def back(peer: WebSocket) -> None:
        await peer.accept()
        try:
            while True:
                await peer.send_text(await peer.receive_text())
        except WebSocketDisconnect:
            pass

    listener = socket.create_server(("127.0.0.1", 0))
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    print(listener.getsockname()[1], file=sys.stderr, flush=True)
    config = uvicorn.Config(
        app, ws="websockets-sansio", ws_per_message_deflate=False, lifespan="off", log_config=None, access_log=False
    )
    asyncio.run(uvicorn.Server(config).serve(sockets=[listener]))


if __name__ == "__main__":
    serve_echo()
