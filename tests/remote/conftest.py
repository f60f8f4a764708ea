"""Oracles in a process of their own, and a server whose specs name them."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection, connect

from tests.whole.harness import PATIENCE, Server

ROOT = Path(__file__).parents[2]


class Oracles:
    """One process of `playing`; with a port, at that port."""

    def __init__(self, port: int = 0) -> None:
        """Listen at a port of `reserved_port`, at any where none is given."""
        command = [sys.executable, "-m", "tests.remote.playing", str(port)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        assert self._process.stdout
        self.port = int(self._process.stdout.readline())

    def url(self, path: str) -> str:
        return f"ws://127.0.0.1:{self.port}/{path}"

    def stop(self) -> None:
        self._process.kill()
        self._process.wait()
        assert self._process.stdout
        self._process.stdout.close()


class Director:
    """What the oracle at `url` is asked, and what it does, as the test says."""

    def __init__(self, socket: ClientConnection, url: str) -> None:
        self._socket, self.url = socket, url

    async def told(self, what: str) -> Any:
        """What the oracle tells next, which must be of this kind."""
        told = await self._next()
        assert what in told, told
        return told

    async def opened(self) -> int:
        """The number of the connection that is made to the oracle next; others may be closed before."""
        while "opened" not in (told := await self._next()):
            assert "closed" in told, told
        return int(told["opened"])

    async def asked(self) -> tuple[int, dict[str, Any]]:
        """The connection and the event that the oracle is asked about next; connections come and go before."""
        while "event" not in (told := await self._next()):
            assert "did" not in told, told
        return told["from"], told["event"]

    async def _next(self) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE):
            told: dict[str, Any] = json.loads(await self._socket.recv())
        return told

    async def say(self, connection: int, text: str | None) -> None:
        """Reply on a connection, or break it."""
        await self._socket.send(json.dumps({"to": connection, "say": text}))
        while "did" not in (told := await self._next()):  # others may have been closed just before
            assert "closed" in told, told


@pytest.fixture(scope="session")
def oracles() -> Iterator[Oracles]:
    running = Oracles()
    yield running
    running.stop()


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("server")
    (folder / "specs").mkdir()
    with Server(folder / "specs", folder / "data") as running:
        yield running


@pytest.fixture(scope="session")
def numbers() -> Iterator[int]:
    return count(1)


@pytest.fixture
def name(numbers: Iterator[int]) -> str:
    """A name of the test's own, for its spec, its session and its oracle."""
    return f"x{next(numbers)}"


@pytest.fixture
async def director(oracles: Oracles, name: str) -> AsyncIterator[Director]:
    async with connect(oracles.url(f"control/{name}"), proxy=None, ping_interval=None, open_timeout=PATIENCE) as socket:
        yield Director(socket, oracles.url(f"play/{name}"))


Start = Callable[[str], Server]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts servers of the test's own with one spec, one after the other, over the same history."""
    (tmp_path / "specs").mkdir()
    with ExitStack() as servers:

        def started(text: str) -> Server:
            (tmp_path / "specs" / "x.yaml").write_text(text)
            return servers.enter_context(Server(tmp_path / "specs", tmp_path / "data"))

        yield started


def spec(name: str, url: str, timeout: str = "100s") -> str:
    """A spec by arrival with an external property beside a plain one, over a topic and a filtered topic."""
    return f"""
id: {name}
ordering: {{by: arrival}}
streams:
  - topic: /a
  - topic: /go
    action: filter
    decide_within: 1000s
properties:
  - id: theirs
    engine: external
    url: {url}
    timeout: {timeout}
    guards: [/go]
  - id: ours
    formula: 'not {{v: 7}}'
    guards: [/go]
    blame: caused
"""


def put(server: Server, name: str, url: str, timeout: str = "100s") -> None:
    """Give the server a spec by `spec`."""
    response = server.http.put(f"/api/v1/specs/{name}", content=spec(name, url, timeout))
    assert response.is_success, response.text


async def said(server: Server, session: str, count: int, prop: str = "theirs") -> list[tuple[str, bool]]:
    """The outcomes of a property, with whether they are degraded, once there are so many."""
    records = await server.until(lambda: server.records(session, property=prop), lambda found: len(found) >= count)
    assert [r["seq"] for r in records] == list(range(1, count + 1))
    return [(r["outcome"], r["degraded"]) for r in records]
