"""A server, and programs on ROS, as processes: what they say, how they end; free of ROS itself."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlencode
from urllib.request import urlopen

from tests.forking import STRICT, Forked, Forks

T = TypeVar("T")
Data = dict[str, Any]
Setting = dict[str, str]

PATIENCE = float(os.environ.get("PATIENCE", "60"))
"""Seconds that anything may take before a test fails."""
ROOT = Path(__file__).parents[1]
SERVER = ROOT / ".build" / "server" / "bin" / "oracle-server"
ROS_ONLY = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
"""What the server, which is no part of ROS, must not see of this environment."""


def environment(without: Sequence[str] = (), **settings: str) -> Setting:
    """This process's environment without what would set up a server or an adapter, and with what is given."""
    plain = {k: v for k, v in os.environ.items() if not k.startswith("ORACLE_") and k not in without}
    return plain | {"COLUMNS": "200"} | settings


def beside_server() -> Setting:
    """What lets a program of this Python import the server's package, behind all else; empty where it can't."""
    packages = SERVER.parents[1] / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
    paths = (str(ROOT), os.environ.get("PYTHONPATH", ""), str(packages))
    return {"PYTHONPATH": os.pathsep.join(path for path in paths if path)} if packages.is_dir() else {}


def reserved_port() -> socket.socket:
    """A port of one's own while this is open: only who is told of it, and shares addresses, can listen there.

    One that is free is not enough: whoever asks for any port, or connects from one, may get it in the meantime.
    """
    place = socket.socket()
    place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    place.bind(("127.0.0.1", 0))
    return place


def held_port(stack: ExitStack) -> int:
    """The number of a port of one's own until `stack` is left."""
    return int(stack.enter_context(reserved_port()).getsockname()[1])


def as_yaml(value: object) -> str:
    """A node's parameter on its command line."""
    return str(value).lower() if isinstance(value, bool) else str(value)


FORKS = Forks(SERVER.parent / "python", environment(ROS_ONLY, **STRICT))


def started(
    command: Sequence[str], setting: Setting, out: int, error: int, forks: Forks | None = None
) -> subprocess.Popen[bytes] | Forked:
    """A program that runs, its output to these files: the server's own are forked, where that makes no difference.

    So are modules of this Python by `forks`.
    """
    if command[0] == str(SERVER) and FORKS.takes(setting):
        return FORKS.fork(command[1:], setting, out, error)
    if forks is not None and command[:2] == [sys.executable, "-m"] and forks.takes(setting):
        return forks.fork(command[3:], setting, out, error, module=command[2])
    return subprocess.Popen(command, stdout=out, stderr=error, env=setting)


class Process:
    """A program that runs, and what it says."""

    def __init__(self, name: str, command: Sequence[object], setting: Setting, forks: Forks | None = None) -> None:
        """Run it; modules of this Python are forked by `forks`."""
        self.name = name
        self._lines: list[str] = []
        self._said = threading.Condition()
        out, into = os.pipe()
        self._out = open(out, encoding="utf-8")  # noqa: SIM115 -- open to the end
        self._process = started([str(word) for word in command], setting, into, into, forks)
        os.close(into)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def log(self) -> str:
        """What it has said so far."""
        with self._said:
            return "".join(self._lines)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def said(self, pattern: str) -> re.Match[str]:
        """Wait until the log holds a pattern."""

        def found() -> re.Match[str] | None:
            return re.search(pattern, "".join(self._lines))

        with self._said:
            self._said.wait_for(lambda: found() or not self._reader.is_alive(), PATIENCE)
            match = found()
        assert match, f"{self.name} did not say {pattern!r}:\n{self.log}"
        return match

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Ask it to end, unless it has, and tell its exit status."""
        if self.running:
            self._process.send_signal(number)
        try:
            return self.wait()
        finally:
            self.remove()

    def wait(self) -> int:
        """Wait for its end, when its log holds all that it said, and tell its exit status."""
        status = self._process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        return status

    def remove(self) -> None:
        """Let nothing of it be left."""
        self._process.kill()
        self._process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        self._out.close()

    def ends_well(self, number: signal.Signals = signal.SIGTERM) -> None:
        """End it: with status 0, without an abort, and with nothing said that is a bug's mark."""
        status = self.end(number)
        assert status == 0, f"{self.name} ended with {status}:\n{self.log}"
        for mark in ("Traceback", "terminate called", "never retrieved", "callback of the link failed"):
            assert mark not in self.log, f"{self.name}:\n{self.log}"

    def _read(self) -> None:
        for line in self._out:
            with self._said:
                self._lines.append(re.sub(r"\x1b\[[0-9;]*m", "", line))
                self._said.notify_all()
        with self._said:
            self._said.notify_all()


class Server:
    """An `oracle-server serve`, which can be killed and started again at the same address on the same data."""

    def __init__(self, specs: Path, data: Path, port: int) -> None:
        self._specs, self._data, self._port = specs, data, port
        self.process, self.url = self._start()

    def restart(self) -> None:
        """Start it again, after `kill`."""
        self.process, self.url = self._start()

    def kill(self) -> None:
        """SIGKILL."""
        self.process.remove()

    def _start(self) -> tuple[Process, str]:
        command = [SERVER, "serve", "--specs", self._specs, "--data-dir", self._data, "--port", self._port]
        process = Process("oracle-server", command, environment(ROS_ONLY, **STRICT))
        try:
            return process, process.said(r"url=(http://\S+)")[1]
        except AssertionError:
            process.remove()
            raise

    def get(self, path: str, **query: Any) -> Any:
        """A document of the API."""
        with urlopen(f"{self.url}/api/v1/{path}?{urlencode(query, doseq=True)}", timeout=PATIENCE) as answer:
            return json.load(answer)

    def session(self, session: str) -> Any:
        """How a session stands."""
        return self.get(f"sessions/{session}")

    def records(self, session: str, what: str = "verdicts", **query: Any) -> list[Data]:
        """All records of a session that a question asks for."""
        return all_pages(self.get, f"sessions/{session}/{what}", query)

    def events(self, session: str, **query: Any) -> list[Data]:
        """The first of each event's records, in the order of judging; ticks are none."""
        steps: dict[int, Data] = {}
        for record in self.records(session, **query):
            if record["kind"] != "tick":
                steps.setdefault(record["step"], record)
        return list(steps.values())


def all_pages(get: Callable[..., Any], path: str, query: Data) -> list[Data]:
    """All items of a list of the API, which `get` gets page by page."""
    items: list[Data] = []
    wanted = {"limit": 1000} | query
    while True:
        page = get(path, **wanted)
        items += page["items"]
        if page["next"] is None:
            return items
        wanted["after"] = page["next"]


def eventually(ask: Callable[[], T], good: Callable[[T], object]) -> T:
    """Ask again and again until the answer is good."""
    end = time.monotonic() + PATIENCE
    while True:
        answer = ask()
        if good(answer):
            return answer
        assert time.monotonic() < end, f"not within {PATIENCE} s; the last answer was {answer!r}"
        time.sleep(0.01)  # between two questions


def without_gaps(numbers: Sequence[int]) -> bool:
    """Whether they are 1, 2, 3…, each once, in whatever order."""
    ordered = sorted(numbers)
    return ordered[:1] == [1] and all(b == a + 1 for a, b in pairwise(ordered))
