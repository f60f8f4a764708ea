"""A server as a process of its own."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self, TypeVar

import httpx

T = TypeVar("T")

PATIENCE = 30.0
"""Seconds that anything may take before a test fails."""
COMMAND = Path(sys.executable).parent / "oracle-server"


def environment(**settings: str) -> dict[str, str]:
    """This process's environment without what would set up a server, and with what is given."""
    plain = {k: v for k, v in os.environ.items() if not k.startswith("ORACLE_")}
    return plain | {"COLUMNS": "200"} | settings


class Server:
    """One `oracle-server serve`; use it as a context manager, or call `stop`."""

    def __init__(self, specs: Path, data: Path, **settings: str) -> None:
        self.specs, self.data = specs, data
        self._lines: list[str] = []
        self._checked = 0
        self._said = threading.Condition()
        command: list[str | Path] = [COMMAND, "serve", "--specs", specs, "--data-dir", data, "--port", "0"]
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment(**settings)
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self.url = self.said(r"url=(https?://\S+)")[1]
        except AssertionError:  # it did not start in time, and would stay behind
            self.process.kill()
            raise
        self.http = httpx.Client(base_url=self.url, timeout=PATIENCE, trust_env=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self.check_log()

    @property
    def log(self) -> str:
        """What the server has said so far."""
        with self._said:
            return "".join(self._lines)

    def said(self, pattern: str) -> re.Match[str]:
        """Wait until the log holds a pattern."""

        def found() -> re.Match[str] | None:
            return re.search(pattern, "".join(self._lines))

        with self._said:
            self._said.wait_for(lambda: found() or not self._reader.is_alive(), PATIENCE)
            match = found()
        assert match, f"the server did not say {pattern!r}:\n{self.log}"
        return match

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """End the server, and tell its exit status."""
        self.process.send_signal(number)
        try:
            return self.process.wait(PATIENCE)
        finally:
            self.end()

    def end(self) -> None:
        """Let nothing of the server be left."""
        self.process.kill()
        self.process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        assert self.process.stderr is not None
        self.process.stderr.close()
        self.http.close()

    def check_log(self) -> None:
        """A traceback in what was said since the last look is a bug, wherever it comes from."""
        with self._said:
            new, self._checked = "".join(self._lines[self._checked :]), len(self._lines)
        assert "Traceback" not in new, new

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def get(self, path: str, **query: Any) -> Any:
        """A document of the API."""
        response = self.http.get(f"/api/v1/{path}", params=query)
        assert response.status_code == 200, (path, query, response.status_code, response.text)
        return response.json()

    def records(self, session: str, what: str = "verdicts", **query: Any) -> list[dict[str, Any]]:
        """All records of a session that a question asks for."""
        items: list[dict[str, Any]] = []
        after = None
        while True:
            page = self.get(f"sessions/{session}/{what}", **({"limit": 1000} | query | cursor(after)))
            items += page["items"]
            after = page["next"]
            if after is None:
                return items

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

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            with self._said:
                self._lines.append(re.sub(r"\x1b\[[0-9;]*m", "", line))
                self._said.notify_all()
        with self._said:
            self._said.notify_all()


def cursor(after: int | None) -> dict[str, Any]:
    return {} if after is None else {"after": after}


def run(*arguments: str | Path, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run the command line to its end."""
    command, env = [COMMAND, *arguments], environment(**settings)
    return subprocess.run(command, capture_output=True, text=True, timeout=2 * PATIENCE, env=env, check=False)


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
