"""A server, an adapter and ROS nodes as processes in a ROS domain of their own, and a node of this process there."""

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
from typing import Any, Self, TypeVar
from urllib.error import URLError
from urllib.parse import urlencode
from urllib.request import urlopen

import pytest

rclpy = pytest.importorskip("rclpy")
executors = pytest.importorskip("rclpy.executors")

T = TypeVar("T")
Data = dict[str, Any]
Setting = dict[str, str]

PATIENCE = 60.0
"""Seconds that anything may take before a test fails."""
ROOT = Path(__file__).parents[2]
SERVER = ROOT / ".build" / "server" / "bin" / "oracle-server"
ROS_ONLY = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
"""What the server, which is no part of ROS, must not see of this environment."""

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def environment(without: Sequence[str] = (), **settings: str) -> Setting:
    """This process's environment without what would set up a server or an adapter, and with what is given."""
    plain = {k: v for k, v in os.environ.items() if not k.startswith("ORACLE_") and k not in without}
    return plain | {"COLUMNS": "200"} | settings


class Process:
    """A program that runs, and what it says."""

    def __init__(self, name: str, command: Sequence[object], setting: Setting) -> None:
        self.name = name
        self._lines: list[str] = []
        self._said = threading.Condition()
        self._process = subprocess.Popen(
            [str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=setting
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def log(self) -> str:
        """What it has said so far."""
        with self._said:
            return "".join(self._lines)

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
            return self._process.wait(PATIENCE)
        finally:
            self.remove()

    def remove(self) -> None:
        """Let nothing of it be left."""
        self._process.kill()
        self._process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        assert self._process.stdout is not None
        self._process.stdout.close()

    def ends_well(self, number: signal.Signals = signal.SIGTERM) -> None:
        """End it: with status 0, without an abort, and with nothing said that is a bug's mark."""
        status = self.end(number)
        assert status == 0, f"{self.name} ended with {status}:\n{self.log}"
        for mark in ("Traceback", "terminate called", "never retrieved", "callback of the link failed"):
            assert mark not in self.log, f"{self.name}:\n{self.log}"

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._said:
                self._lines.append(re.sub(r"\x1b\[[0-9;]*m", "", line))
                self._said.notify_all()
        with self._said:
            self._said.notify_all()


class Server:
    """An `oracle-server serve`, which can be killed and started again at the same address on the same data."""

    def __init__(self, specs: Path, data: Path) -> None:
        self._specs, self._data = specs, data
        self._port = "0"
        self.process, self.url = self._start()
        self._port = self.url.rpartition(":")[2]

    def restart(self) -> None:
        """Start it again, after `kill`."""
        self.process, self.url = self._start()

    def kill(self) -> None:
        """SIGKILL."""
        self.process.remove()

    def _start(self) -> tuple[Process, str]:
        command = [SERVER, "serve", "--specs", self._specs, "--data-dir", self._data, "--port", self._port]
        process = Process("oracle-server", command, environment(ROS_ONLY))
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
        items: list[Data] = []
        after: Data = {}
        while True:
            page = self.get(f"sessions/{session}/{what}", limit=1000, **query, **after)
            items += page["items"]
            if page["next"] is None:
                return items
            after = {"after": page["next"]}

    def events(self, session: str, **query: Any) -> list[Data]:
        """The first of each event's records, in the order of judging; ticks are none."""
        steps: dict[int, Data] = {}
        for record in self.records(session, **query):
            if record["kind"] != "tick":
                steps.setdefault(record["step"], record)
        return list(steps.values())

    def reachable(self) -> bool:
        try:
            self.get("sessions")
        except URLError:
            return False
        return True


class Peer:
    """A node of this process; it is spun while a test waits, by `until`."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("peer", context=self.context)
        self._executor = executors.SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)

    def record(self, kind: Any, topic: str, qos: Any = 5000) -> list[Any]:
        """A list that grows by what is heard."""
        heard: list[Any] = []
        self.node.create_subscription(kind, topic, heard.append, qos)
        return heard

    def publisher(self, kind: Any, topic: str, listeners: int = 1, qos: Any = 5000) -> Any:
        """A publisher that so many hear already."""
        made = self.node.create_publisher(kind, topic, qos)
        self.until(lambda: made.get_subscription_count() >= listeners, f"nobody hears {topic}")
        return made

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """The answer of a service."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, f"nobody serves {service}")
        answer = client.call_async(request)
        self.until(answer.done, f"{service} does not answer")
        return answer.result()

    def until(self, condition: Callable[[], object], what: str = "the nodes are stuck") -> None:
        """Spin until the condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, what
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Scene:
    """A domain and a server, with the processes and nodes that a test adds; at the end none is left."""

    def __init__(self, folder: Path, specs: Path = ROOT / "specs") -> None:
        self._folder, self._specs = folder, specs
        self._processes: list[Process] = []

    def __enter__(self) -> Self:
        self._folder.mkdir(exist_ok=True)
        with ExitStack() as begun:  # undone where the server does not start
            self.domain = self._free_domain(begun)
            self.server = Server(self._specs, self._folder / "data")
            begun.callback(self.server.kill)
            self._stack = begun.pop_all()
        return self

    def __exit__(self, failure: object, *_: object) -> None:
        self._stack.close()
        if failure:
            for process in (self.server.process, *self._processes):
                print(f"== {process.name} said:\n{process.log}")

    def run(self, name: str, *command: object) -> Process:
        """A program on ROS, removed at the end."""
        settings = environment(ROS_DOMAIN_ID=str(self.domain), ROS_LOG_DIR=str(self._folder / "ros"))
        process = Process(name, command, settings)
        self._stack.callback(process.remove)
        self._processes.append(process)
        return process

    def adapter(self, spec: str, session: str = "s", monitor: str = "uav1", more: Sequence[str] = ()) -> Process:
        """An adapter that observes; `more` are more of its arguments."""
        words = ("--oracle", self.server.url, "--spec", spec, "--session", session, "--monitor", monitor, *more)
        process = self.run("adapter", sys.executable, "-m", "oracle_ros2", *words)
        process.said("observing")
        return process

    def node(self, module: str, **parameters: object) -> Process:
        """One of the example's nodes."""
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={str(value).lower()}")]
        return self.run(module, sys.executable, "-m", f"battery_uav.{module}", "--ros-args", *words)

    def peer(self) -> Peer:
        peer = Peer(self.domain)
        self._stack.callback(peer.close)
        return peer

    @staticmethod
    def _free_domain(stack: ExitStack) -> int:
        """A ROS domain that no other test on this machine uses; a bound port says which are taken."""
        for number in range(20, 100):
            mark = socket.socket()
            try:
                mark.bind(("127.0.0.1", 21000 + number))
            except OSError:
                mark.close()
                continue
            stack.callback(mark.close)
            return number
        pytest.fail("all domains are taken")


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
