"""A server as a process of its own."""

from __future__ import annotations

import asyncio
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Self, TypeVar

import httpx

from tests.forking import STRICT
from tests.processes import PATIENCE, Process, all_pages, environment, started

__all__ = ["COMMAND", "PATIENCE", "STRICT", "Server", "environment", "failed", "problem", "run"]

T = TypeVar("T")

COMMAND = Path(sys.executable).parent / "oracle-server"
_TRUSTED = httpx.create_ssl_context(trust_env=False)  # made once: it takes longer than a request


class Server:
    """One `oracle-server serve`, on a port of its own; use it as a context manager, or call `stop`."""

    def __init__(self, specs: Path, data: Path, port: str = "0", **settings: str) -> None:
        self.specs, self.data = specs, data
        self._checked = 0
        command: list[str | Path] = [COMMAND, "serve", "--specs", specs, "--data-dir", data, "--port", port]
        self.process = Process("the server", command, environment(**STRICT, **settings))
        try:
            self.url = self.said(r"url=(https?://\S+)")[1]
        except AssertionError:  # it did not start in time, and would stay behind
            self.process.remove()
            raise
        # the server closes a connection that was idle for 5 s: none is used again that is nearly as old
        limits = httpx.Limits(keepalive_expiry=1)
        self.http = httpx.Client(base_url=self.url, timeout=PATIENCE, trust_env=False, limits=limits, verify=_TRUSTED)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self.check_log()

    @property
    def log(self) -> str:
        """What the server has said so far."""
        return self.process.log

    def said(self, pattern: str) -> re.Match[str]:
        """Wait until the log holds a pattern."""
        return self.process.said(pattern)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """End the server, and tell its exit status."""
        try:
            return self.process.end(number)
        finally:
            self.http.close()

    def end(self) -> None:
        """Let nothing of the server be left."""
        self.process.remove()
        self.http.close()

    def check_log(self) -> None:
        """A traceback in what was said since the last look is a bug, wherever it comes from."""
        log = self.log
        new, self._checked = log[self._checked :], len(log)
        assert "Traceback" not in new, new

    @property
    def alive(self) -> bool:
        return self.process.running

    def get(self, path: str, **query: Any) -> Any:
        """A document of the API."""
        response = self.http.get(f"/api/v1/{path}", params=query)
        assert response.status_code == 200, (path, query, response.status_code, response.text)
        return response.json()

    def records(self, session: str, what: str = "verdicts", **query: Any) -> list[dict[str, Any]]:
        """All records of a session that a question asks for."""
        return all_pages(self.get, f"sessions/{session}/{what}", query)

    async def until(self, ask: Callable[[], T], good: Callable[[T], object]) -> T:
        """Ask again and again until the answer is good."""
        deadline = time.monotonic() + PATIENCE
        while True:
            answer = ask()
            if good(answer):
                return answer
            assert time.monotonic() < deadline, f"not within {PATIENCE} s; the last answer was {answer!r}"
            await asyncio.sleep(0.01)

    async def holds(self, session: str, count: int) -> None:
        """Wait until a session holds so many events."""
        await self.until(lambda: self.get(f"sessions/{session}")["counters"]["held"], lambda held: held == count)


def run(*arguments: str | Path, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run the command line to its end."""
    command = [str(COMMAND), *map(str, arguments)]
    with TemporaryFile("w+", encoding="utf-8") as out, TemporaryFile("w+", encoding="utf-8") as error:
        process = started(command, environment(**STRICT, **settings), out.fileno(), error.fileno())
        try:
            status = process.wait(2 * PATIENCE)
        finally:
            process.kill()
        for file in (out, error):
            file.seek(0)
        return subprocess.CompletedProcess(command, status, out.read(), error.read())


def failed(*arguments: str | Path, **settings: str) -> str:
    """What a command says that can't do what it is asked: one line, and nothing else."""
    ended = run(*arguments, **settings)
    assert ended.returncode == 2, ended
    (line,) = ended.stderr.splitlines()
    assert line.startswith("oracle-server: ")
    return line


def problem(response: httpx.Response, status: int) -> dict[str, Any]:
    """The problem that a response tells."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"].split(";")[0] == "application/problem+json"
    body: dict[str, Any] = response.json()
    assert body["status"] == status
    assert body["title"]
    assert body["detail"]
    assert body["type"]
    return body
