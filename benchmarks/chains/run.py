"""The run: every path, round by round, each part a process of its own."""

from __future__ import annotations

import argparse
import json
import math
import os
import queue
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from .measured import RESTED, Measured, print_goals, print_table, rows
from .parts import CALLS, GOALS, PATIENCE

ROOT = Path(__file__).resolve().parents[2]
SERVER = ROOT / ".build" / "server" / "bin" / "oracle-server"
PACKAGES = SERVER.parents[1] / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
"""Where an adapter of this Python finds the server's package, to judge by itself."""
PATHS: tuple[str, ...] = ("direct", "bare", "oracle", "embedded")
ROS_ONLY = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
RATES = (100, 1000)

TOPIC = """
id: topic
description: Every message is asked for, and passes
streams:
  - topic: /number
    type: std_msgs/msg/Int64
    action: filter
    intercept: subscriber
    signals: {value: msg.data}
properties:
  - id: no_seven
    formula: 'not {topic: "/number", value: 7}'
    guards: [/number]
"""
SERVICES = """
id: NAME
description: Every request and response is asked for, and passes
streams:STREAMS
properties:
  - id: no_nonsense
    formula: 'not {text: "nonsense"}'
    guards: [GUARDED]
"""
SERVICE = """
  - service: NAME
    type: std_srvs/srv/SetBool
    action: filter
    request: {signals: {on: msg.data}}
    response: {signals: {text: msg.message}}"""
ACTION = """
id: action
description: Every goal is asked for, and where ROS has replies these too, and passes; the rest is logged
streams:STREAM
properties:
  - id: no_nonsense
    formula: 'not {ros_action: "/fib", order: -1}'
    guards: [/fib]
"""
FEW = 1
KEPT = (FEW, 200)
"""How many goals an action's server remembers at least while it is measured."""
PAUSE = 0.1
"""Seconds between goals that are measured, and for which each is kept where few are."""
LAST_WORDS = 5.0
"""Seconds in which a process that is given up may still say something."""
CALLED = {
    "service": (["/switch"], 0.0),
    RESTED: (["/switch"], PAUSE),
    "one of 4 services": (["/switch", "/second", "/third", "/fourth"], 0.0),
}
"""The services of a session, of which the first is called, and the pause (s) before each call."""


def specs(ros: Ros) -> Iterator[tuple[str, str]]:
    """The specs' ids and texts."""
    yield "topic", TOPIC
    yield "action", ACTION.replace("STREAM", ros.action)
    for case, (names, _) in CALLED.items():
        streams = "".join(SERVICE.replace("NAME", name) for name in names)
        text = SERVICES.replace("NAME", spec_of(case)).replace("STREAMS", streams)
        yield spec_of(case), text.replace("GUARDED", ", ".join(names))


def spec_of(case: str) -> str:
    """The id of a case's spec."""
    return case.replace(" ", "_").replace(",", "").replace(".", "")


class Part:
    """A process; what it says is read at once, so that it never waits for a reader."""

    def __init__(self, command: list[object], setting: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            [str(word) for word in command],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=setting,
        )  # fmt: skip
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def until(self, pattern: str, more: float = 0) -> re.Match[str]:
        """The next line that has the pattern.

        Where that takes `more` seconds too long the process is ended, and a Python one tells where its threads are.
        """
        seen = []
        due = time.monotonic() + PATIENCE + more
        while (line := self._next(due)) is not None:
            match = re.search(pattern, re.sub(r"\x1b\[[0-9;]*m", "", line))
            if match:
                return match
            seen.append(line)
        self._process.send_signal(signal.SIGABRT)
        while (line := self._next(time.monotonic() + LAST_WORDS)) is not None:
            seen.append(line)
        what = f"{PATIENCE + more} s" if time.monotonic() > due else "what it said before it ended"
        raise SystemExit(f"no {pattern!r} in {what}: {''.join(seen[-100:])}")

    def _next(self, due: float) -> str | None:
        """The next line; None where there is none in time, or any more."""
        with suppress(queue.Empty):
            return self._lines.get(timeout=max(0.0, due - time.monotonic()))
        return None

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put(None)

    @property
    def cpu(self) -> float:
        """The CPU seconds that it has spent."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def tell(self, word: str) -> None:
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write(word + "\n")
            self._process.stdin.flush()

    def finish(self) -> None:
        """Let it end by itself."""
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(PATIENCE)

    def end(self) -> None:
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(PATIENCE)


@dataclass(frozen=True)
class Ros:
    """What a run has to know of the ROS that it is on."""

    script: str
    """The program that is also each part, by `--part NAME WORDS…`."""
    adapter: str
    """The adapter's module."""
    parts: Mapping[str, Callable[..., None]]
    action: str
    """The stream of the action `/fib`; a signal of its goals is `order`."""
    settings: Mapping[str, str]
    """What its processes find in their environment."""
    core: tuple[str, ...] = ()
    """What all nodes need running, as a command; it says `started core service`."""


class Run:
    """One benchmark: a graph, a folder, and what was measured of each case on each path."""

    def __init__(
        self,
        folder: Path,
        ros: Ros,
        seconds: float,
        *,
        topics: bool = True,
        calls: bool = True,
        paths: tuple[str, ...] = PATHS,
    ) -> None:
        self.measured: dict[tuple[str, str], Measured] = {}
        self._paths = paths
        self._between: list[Part] = []
        self._folder, self._ros, self._seconds, self._topics, self._calls = folder, ros, seconds, topics, calls
        self._setting = {**os.environ, **ros.settings, "ROS_LOG_DIR": str(folder / "ros"), "PYTHONFAULTHANDLER": "1"}
        (folder / "specs").mkdir()
        for name, text in specs(ros):
            (folder / "specs" / f"{name}.yaml").write_text(text)

    def rounds(self, count: int) -> None:
        with ExitStack() as stack:
            if self._ros.core:
                core = self._start(stack, list(self._ros.core))
                stack.callback(core.finish)  # or it would leave its own processes
                core.until("started core service")
            for _ in range(count):
                self._round()

    def _round(self) -> None:
        chains = {"direct": self._direct, "bare": self._bare, "oracle": self._oracle, "embedded": self._embedded}
        for path in self._paths:
            chain = chains[path]
            for rate in RATES if self._topics else ():
                with chain("topic"):
                    self._measure_topic(path, rate)
            for case, (_, pause) in CALLED.items() if self._calls else ():
                with chain(spec_of(case)):
                    self._measure_service(case, path, pause)
            for kept in KEPT if self._calls else ():
                with chain("action"):
                    self._measure_action(path, kept)

    def _part(self, stack: ExitStack, *words: object) -> Part:
        return self._start(stack, [sys.executable, self._ros.script, "--part", *words])

    def _start(self, stack: ExitStack, command: list[object], without: tuple[str, ...] = (), **more: str) -> Part:
        part = Part(command, {k: v for k, v in self._setting.items() if k not in without} | more)
        stack.callback(part.end)
        return part

    @contextmanager
    def _direct(self, _what: str) -> Iterator[None]:
        self._between = []
        yield

    @contextmanager
    def _bare(self, _what: str) -> Iterator[None]:
        with ExitStack() as stack:
            echo = self._part(stack, "echo")
            bare = self._part(stack, "bare", echo.until(r"port=(\d+)")[1])
            bare.until("ready")
            self._between = [echo, bare]
            yield

    @contextmanager
    def _oracle(self, what: str) -> Iterator[None]:
        with ExitStack() as stack:
            data = tempfile.mkdtemp(dir=self._folder)
            command = [SERVER, "serve", "--specs", self._folder / "specs", "--data-dir", data, "--port", "0"]
            server = self._start(stack, command, ROS_ONLY)
            url = server.until(r"url=(http://\S+)")[1]
            adapter = self._start(stack, [sys.executable, "-m", self._ros.adapter, "--oracle", url, "--spec", what])
            adapter.until("observing")
            self._between = [server, adapter]
            yield

    @contextmanager
    def _embedded(self, what: str) -> Iterator[None]:
        with ExitStack() as stack:
            spec, data = self._folder / "specs" / f"{what}.yaml", tempfile.mkdtemp(dir=self._folder)
            command = [sys.executable, "-m", self._ros.adapter, "--embedded", spec, "--data", data]
            found = [str(ROOT), *filter(None, [self._setting.get("PYTHONPATH")]), str(PACKAGES)]
            adapter = self._start(stack, command, PYTHONPATH=os.pathsep.join(found))
            adapter.until("observing")
            self._between = [adapter]
            yield

    @property
    def _spent(self) -> float:
        """The CPU seconds of what stands between the nodes."""
        return sum(part.cpu for part in self._between)

    def _measure_topic(self, path: str, rate: int) -> None:
        wanted = int(rate * self._seconds)
        with ExitStack() as stack:
            receiver = self._part(stack, "receive", "/number" if path == "direct" else "/number_mon", wanted)
            sender = self._part(stack, "send", rate, self._seconds)
            receiver.until("heard")
            spent = self._spent
            sender.tell("go")
            sender.until("sent", self._seconds)
            receiver.tell("stop")
            latencies = json.loads(receiver.until(r"^\[.*\]$")[0])
            spent = self._spent - spent
            sender.tell("end")
        self._add(f"topic at {rate} Hz", path, wanted, latencies, spent)

    def _measure_service(self, case: str, path: str, pause: float) -> None:
        with ExitStack() as stack:
            self._part(stack, "serve").until("ready")
            spent = self._spent
            caller = self._part(stack, "call", "/switch" if path == "direct" else "/switch_mon", pause)
            latencies = json.loads(caller.until(r"^\[.*\]$", PATIENCE)[0])
            spent = self._spent - spent
        self._add(case, path, CALLS, latencies, spent)

    def _measure_action(self, path: str, kept: int) -> None:
        with ExitStack() as stack:
            self._part(stack, "perform", kept).until("ready")
            client = self._part(stack, "act", "/fib" if path == "direct" else "/fib_mon", kept)
            found = json.loads(client.until(r"^\{.*\}$", 8 * PATIENCE)[0])
        for case, latencies in found.items():
            self._add(f"{case}, {kept} kept", path, GOALS, latencies)

    def _add(self, case: str, path: str, sent: int, latencies: list[float], spent: float = math.nan) -> None:
        measured = self.measured.setdefault((case, path), Measured())
        measured.sent += sent
        measured.latencies += latencies
        measured.cpu += spent


def free_port() -> int:
    with socket.socket() as mark:
        mark.bind(("127.0.0.1", 0))
        return int(mark.getsockname()[1])


def main(ros: Ros, description: str | None) -> None:
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=2.0, help="how long a topic is published (%(default)s)")
    some = parser.add_mutually_exclusive_group()
    some.add_argument("--no-topics", action="store_true", help="services and actions alone")
    some.add_argument("--topics-alone", action="store_true", help="neither services nor actions")
    parser.add_argument("--json", action="store_true", help="one JSON document instead of a table")
    parser.add_argument("--part", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        ros.parts[options.part[0]](*options.part[1:])
        return
    before, paths = os.getloadavg()[0], PATHS
    if not PACKAGES.is_dir():
        print(f"embedded is left out: {PACKAGES} is not there, the server has another Python", file=sys.stderr)
        paths = PATHS[:3]
    with tempfile.TemporaryDirectory(prefix="oracle-benchmark.") as folder:
        topics, calls = not options.no_topics, not options.topics_alone
        run = Run(Path(folder), ros, options.seconds, topics=topics, calls=calls, paths=paths)
        run.rounds(options.rounds)
    found = rows(run.measured)
    if options.json:
        print(json.dumps({"cpus": os.cpu_count(), "load_before": before, "rows": found}))
        return
    print_table(found)
    if calls:
        print_goals(run.measured, KEPT)
    print(f"{os.cpu_count()} CPUs; load before the run {before:.1f}")
