"""What the processes of a chain do that is no ROS: they are told, tell, and talk over a WebSocket."""

from __future__ import annotations

import asyncio
import importlib
import inspect
import json
import math
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

PATIENCE = 30.0
DEPTH = 2000
CALLS = 200
GOALS = 100
WARM_UP = -1


def say(word: str) -> None:
    print(word, flush=True)


def told() -> deque[str]:
    """The lines that this process is told, as they come."""
    lines: deque[str] = deque()

    def follow() -> None:
        lines.extend(sys.stdin)  # one by one

    threading.Thread(target=follow, daemon=True).start()
    return lines


def wait(condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)


def send_times(rate: int, seconds: float, publish: Callable[[int], None]) -> None:
    """Publish to warm up until told, and then the time (ns) at the rate."""
    lines = told()
    while not lines:
        publish(WARM_UP)
        time.sleep(0.02)
    time.sleep(0.2)
    due = time.monotonic()
    for _ in range(int(rate * seconds)):
        time.sleep(max(0.0, due - time.monotonic()))
        publish(time.monotonic_ns())
        due += 1 / rate
    say("sent")
    wait(lambda: len(lines) > 1)


def hear_times(wanted: int, subscribe: Callable[[Callable[[Any], None]], object], rest: Callable[[], object]) -> None:
    """Tell that something came; then, when all is there or nothing more comes, the latencies (ms)."""
    latencies: list[float] = []
    warm: list[bool] = []

    def hear(message: Any) -> None:
        now = time.monotonic_ns()
        if message.data != WARM_UP:
            latencies.append((now - message.data) / 1e6)
        elif not warm:
            warm.append(True)
            say("heard")

    subscribe(hear)
    lines = told()
    patience = math.inf
    while len(latencies) < wanted and time.monotonic() < patience:
        rest()
        if lines and patience == math.inf:
            patience = time.monotonic() + 3.0
    say(json.dumps(latencies))


def time_calls(call: Callable[[], object], pause: float) -> None:
    """Call one after the other, after a pause (s) each, and tell the latencies (ms)."""
    latencies = []
    for number in range(CALLS + 20):
        time.sleep(pause)
        began = time.monotonic_ns()
        call()
        if number >= 20:
            latencies.append((time.monotonic_ns() - began) / 1e6)
    say(json.dumps(latencies))


def echo() -> None:
    """A WebSocket server that sends back what it gets."""
    server = importlib.import_module("websockets.asyncio.server")

    async def answer(socket: Any) -> None:
        async for frame in socket:
            await socket.send(frame)

    async def main() -> None:
        async with server.serve(answer, "127.0.0.1", 0, compression=None) as running:
            say(f"port={running.sockets[0].getsockname()[1]}")
            await asyncio.Event().wait()

    asyncio.run(main())


class BareLink:
    """Texts out and, in the same order, back; in a thread of its own."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._waiting: deque[Callable[[], None]] = deque()
        self._loop = asyncio.new_event_loop()
        self._queue: deque[str] = deque()
        self._woken = asyncio.Event()
        self._connected = threading.Event()
        threading.Thread(target=lambda: self._loop.run_until_complete(self._talk()), daemon=True).start()
        assert self._connected.wait(PATIENCE)

    def ask(self, text: str, then: Callable[[], None]) -> None:
        self._waiting.append(then)
        self._queue.append(text)
        self._loop.call_soon_threadsafe(self._woken.set)

    async def _talk(self) -> None:
        client = importlib.import_module("websockets.asyncio.client")
        known = inspect.signature(client.connect.__init__).parameters  # the version for Python 3.8 knows no proxies
        options = {"proxy": None} if "proxy" in known else {}
        async with client.connect(f"ws://127.0.0.1:{self._port}", compression=None, **options) as socket:
            self._connected.set()
            writing = asyncio.ensure_future(self._write(socket))
            async for _ in socket:
                self._waiting.popleft()()
            writing.cancel()

    async def _write(self, socket: Any) -> None:
        while True:
            await self._woken.wait()
            self._woken.clear()
            while self._queue:
                await socket.send(self._queue.popleft())
