"""A real `oracle-server serve`, in a process of its own, to be killed, frozen and started again."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Self

import httpx

from tests.forking import STRICT, Forked
from tests.processes import FORKS, PATIENCE, ROS_ONLY, environment, reserved_port

__all__ = ["PATIENCE", "Ended", "Served", "reviving"]

_MAIN = "from oracle_server.cli.commands import main; main()"
_OFTEN = "from oracle_server.history.sql import writer; writer.PERIOD = 0"
"""Commits as they come and not gathered: there are the more moments to strike at."""
_LONGEST = 2**24
"""Bytes of a line of the log: with a longer one its reading would end, and then the server would wait for it."""


class Ended(AssertionError):  # noqa: N818
    """A process ended before it accepted work."""


class Served:
    """One server and its data directory, over all the processes that serve it; they share a port."""

    def __init__(self, specs: Path, data: Path, prelude: str = "", early: str = "", **settings: str) -> None:
        """Serve the specs of a folder; `settings` are those of the environment, without their prefix.

        `prelude` is Python that each process runs before it becomes a server, and `early` what it runs before it
        imports anything of the product: modules may have by its name what that changes.
        """
        self._prelude, self._early = f"{_OFTEN}\n{prelude}", early
        self.up = asyncio.Event()
        self.starts = 0
        self.log: list[dict[str, Any]] = []
        self._said = asyncio.Condition()
        self._arguments = ("serve", "--specs", str(specs), "--data-dir", str(data))
        self._environment = environment(ROS_ONLY, **STRICT)
        self.set(log="json", **settings)
        self._place = reserved_port()
        self._died = asyncio.Event()
        self._process: subprocess.Popen[bytes] | Forked
        self._reading: asyncio.Task[None]

    @property
    def url(self) -> str:
        """Where the server answers HTTP."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def attach_url(self) -> str:
        """Where monitors attach."""
        return f"ws://127.0.0.1:{self.port}/api/v1/attach"

    @property
    def port(self) -> int:
        """The port, which nobody else gets while no process serves it."""
        return int(self._place.getsockname()[1])

    @property
    def pid(self) -> int:
        """The process, or the last one."""
        return self._process.pid

    def set(self, **settings: str) -> None:
        """Have processes that are started from now on take settings, besides those that they have already."""
        self._environment |= {f"ORACLE_{name.upper()}": value for name, value in settings.items()}

    async def start(self) -> None:
        """Start a process, the first one or once the last one is killed, and return once it accepts work."""
        if self.starts:
            await self.ended()
        said, error = os.pipe()
        self._process = self._started([*self._arguments, "--port", str(self.port)], error)
        os.close(error)
        self._died.clear()
        accepts = asyncio.Event()
        self._reading = asyncio.create_task(self._read_log(said, accepts))
        self._reading.add_done_callback(lambda _: accepts.set())
        async with asyncio.timeout(PATIENCE):
            await accepts.wait()
        self.starts += 1
        if self._reading.done():
            raise Ended(f"{self.log[-5:]}")
        self.up.set()

    def _started(self, arguments: list[str], error: int) -> subprocess.Popen[bytes] | Forked:
        if not self._early and FORKS.takes(self._environment):
            return FORKS.fork(arguments, self._environment, error, error, self._prelude)
        program = f"{self._early}\n{self._prelude}\n{_MAIN}"
        return subprocess.Popen([sys.executable, "-c", program, *arguments], env=self._environment, stderr=error)

    def kill(self) -> None:
        """End the process at once; it gets no chance to do anything."""
        self.up.clear()
        self._process.kill()
        self._died.set()

    async def revive(self) -> None:
        """Start again each time the process is killed, for ever."""
        while True:
            await self._died.wait()
            await self.start()

    def signal(self, number: signal.Signals) -> None:
        """Send the process a signal."""
        self._process.send_signal(number)

    def freeze(self) -> None:
        """Stop the process where it stands."""
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let a frozen process go on."""
        self._process.send_signal(signal.SIGCONT)

    async def said(self, event: str, times: int = 1) -> None:
        """Wait until the log has so many lines of this event."""
        async with asyncio.timeout(PATIENCE), self._said:
            await self._said.wait_for(lambda: self.count(event) >= times)

    def count(self, event: str) -> int:
        """How many lines of this event the log has."""
        return sum(line["event"] == event for line in self.log)

    async def ended(self) -> int:
        """Wait for the end of the process, and return its exit status; its log is whole then."""
        await asyncio.wait((self._reading,))
        return await asyncio.to_thread(self._process.wait, PATIENCE)

    async def stop(self) -> int:
        """Stop cleanly, and return the exit status."""
        self.up.clear()
        self._process.send_signal(signal.SIGTERM)
        async with asyncio.timeout(PATIENCE):
            return await self.ended()

    async def close(self) -> None:
        """End the process, if it still runs, however it can be done."""
        self._process.kill()
        await self.ended()
        self._place.close()

    async def get(self, path: str, **query: int) -> dict[str, Any]:
        """A document of the API."""
        async with self._http() as http:
            return await _document(http, path, query)

    async def records(self, session: str) -> list[dict[str, Any]]:
        """All of a session's history."""
        found: list[dict[str, Any]] = []
        async with self._http() as http:
            after: int | None = 0
            while after is not None:
                page = await _document(http, f"sessions/{session}/verdicts", {"after": after, "limit": 1000})
                found += page["items"]
                after = page["next"]
        return found

    @property
    def complaints(self) -> list[dict[str, Any]]:
        """What the log holds besides what is usual: errors, warnings, tracebacks.

        A server that gets no processor for a while stands still, and violations are what it is there to log.
        """
        usual = ("the event loop st", "violation: ", "more violations are in the history")
        return [
            line
            for line in self.log
            if line.get("level") != "info" and not any(text in line["event"] for text in usual)
        ]

    def _http(self) -> httpx.AsyncClient:
        return httpx.AsyncClient(base_url=f"{self.url}/api/v1/", timeout=PATIENCE, trust_env=False, verify=False)

    async def _read_log(self, said: int, accepts: asyncio.Event) -> None:
        log = asyncio.StreamReader(_LONGEST)
        transport, _ = await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(log),
            open(said, "rb", buffering=0),  # noqa: SIM115 -- its transport closes it
        )
        with contextlib.closing(transport):
            await self._read_lines(log, accepts)

    async def _read_lines(self, log: asyncio.StreamReader, accepts: asyncio.Event) -> None:
        async for text in log:
            try:
                line = json.loads(text)
            except ValueError:
                line = {"event": text.decode(errors="replace").rstrip()}
            async with self._said:
                self.log.append(line)
                self._said.notify_all()
            if line["event"] == "accepting work":
                accepts.set()

    async def __aenter__(self) -> Self:
        """Start it."""
        try:
            await self.start()
        except BaseException:
            await self.close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        """End it."""
        await self.close()


async def _document(http: httpx.AsyncClient, path: str, query: dict[str, int]) -> dict[str, Any]:
    response = await http.get(path, params=query)
    response.raise_for_status()
    document: dict[str, Any] = response.json()
    return document


@contextlib.asynccontextmanager
async def reviving(served: Served) -> AsyncIterator[None]:
    """Start a server again each time it is killed, until the end of the block."""
    task = asyncio.create_task(served.revive())
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
