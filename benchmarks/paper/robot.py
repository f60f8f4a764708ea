"""The battery UAV, a monitor and an oracle as processes, and what they cost."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from benchmarks.paper.kept import SESSION, Kept, close
from benchmarks.paper.stalls import LINKS

ROOT = Path(__file__).resolve().parents[2]
SERVER = ROOT / ".build" / "server" / "bin" / "oracle-server"
ROS_ONLY = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
PATIENCE = 60.0
SETTLE = 1.5
"""Seconds after the last stall until all has arrived and was judged."""
REVISES = "late: revise"
"""What stands in a spec whose verdicts are revised."""
_TICK = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Cost:
    """What a process has used so far: seconds of CPU, and at most so many MB of memory."""

    cpu: float
    memory: float


class Process:
    """A program, its log and its cost."""

    def __init__(self, name: str, command: Sequence[object], setting: dict[str, str]) -> None:
        self.name, self.log = name, ""
        self._said = threading.Condition()
        self._process = subprocess.Popen(
            [str(word) for word in command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=setting,
        )
        threading.Thread(target=self._read, daemon=True).start()

    def said(self, pattern: str) -> re.Match[str]:
        """Wait until the log holds a pattern."""
        with self._said:
            found = self._said.wait_for(lambda: re.search(pattern, self.log), PATIENCE)
        if not found:
            raise SystemExit(f"{self.name} did not say {pattern!r} within {PATIENCE:.0f} s:\n{self.log}")
        return found

    def tell(self) -> None:
        """Send it an empty line."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()

    def cost(self) -> Cost:
        """As `/proc` tells it; of a live process."""
        folder = Path("/proc") / str(self._process.pid)
        fields = (folder / "stat").read_text().rpartition(")")[2].split()
        peak = re.search(r"VmHWM:\s+(\d+)", (folder / "status").read_text())
        return Cost((int(fields[11]) + int(fields[12])) / _TICK, int(peak[1]) / 1024 if peak else 0.0)

    def wait(self) -> None:
        self._process.wait(PATIENCE)

    def end(self) -> None:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._said:
                self.log += re.sub(r"\x1b\[[0-9;]*m", "", line)
                self._said.notify_all()


class Robot:
    """One run: the three nodes, with an oracle's monitor in between or without one; all ends with the block."""

    def __init__(self, folder: Path, spec: str | None, jitter: int, stalls: int | None = None) -> None:
        """`jitter` (ms) delays the percentages; `stalls` is the seed of those of all topics."""
        self.costs: dict[str, Cost] = {}
        """By process, over the countdown."""
        self.calls: list[float] = []
        """The response times of the service calls (ms), in their order."""
        self.denied = 0
        """How many of them were denied."""
        self.stalls: list[tuple[float, int]] = []
        """How long each stall was (s), and how many messages it held."""
        self.history = folder / "data"
        self.kept: Kept | None = None
        """What the oracle has kept of a run with stalls."""
        self._folder, self._spec, self._jitter, self._seed = folder, spec, jitter, stalls
        self._processes: dict[str, Process] = {}

    def fly(self) -> None:
        """Count down from 100 % to 0, and end everything in order."""
        with ExitStack() as stack:
            if self._spec is not None:
                self._start_oracle(stack, self._spec)
            monitors = 0 if self._spec is None else 1
            service = "/SetLED" if self._spec is None else "/SetLED_mon"
            self._start_node(stack, "led_panel", wait_for=monitors)
            self._start_node(stack, "supervisor", wait_for=monitors, service=service)
            self._processes["led_panel"].said("ready")
            gate = self._start(stack, "gate", [sys.executable, "-m", "benchmarks.paper.gate"])
            gate.said("ready")
            battery = self._start_node(stack, "battery", wait_for=monitors + 2)
            battery.said("waiting")
            time.sleep(1)  # all find each other
            gate.tell()
            battery.said("ready")
            del self._processes["gate"]
            before = {name: p.cost() for name, p in self._processes.items()}
            time.sleep(101 / 25)
            for name, process in self._processes.items():
                after = process.cost()
                self.costs[name] = Cost(after.cpu - before[name].cpu, after.memory)
            battery.wait()
            time.sleep(0.5)  # what is on its way arrives
            log = self._processes["supervisor"].log
            self.calls = [float(ms) for ms in re.findall(r"(?:done|denied) after ([\d.]+) ms", log)]
            self.denied = log.count("denied after")
            if self._seed is not None:
                self._end_stalls()

    def _end_stalls(self) -> None:
        """Once nothing is held any more, close the session, and take what it has kept."""
        log = self._processes["relay"].said("no more stalls")
        time.sleep(SETTLE)
        self.stalls = [(float(s), int(n)) for s, n in re.findall(r"stall of \w+: ([\d.]+) s, held (\d+)", log.string)]
        self._processes["monitor"].end()
        self.kept = close(self._url, revising=REVISES in (self._spec or ""))

    def _start_oracle(self, stack: ExitStack, spec: str) -> None:
        specs = self._folder / "specs"
        specs.mkdir(parents=True)
        (specs / "battery_uav.yaml").write_text(spec)
        command = [SERVER, "serve", "--specs", specs, "--data-dir", self.history, "--port", "0"]
        self._url: str = self._start(stack, "server", command, without=ROS_ONLY).said(r"url=(http://\S+)")[1]
        words = ["--oracle", self._url, "--spec", "battery_uav", "--session", SESSION, "--monitor", "uav1"]
        if self._jitter:
            seed = [] if self._seed is None else [self._seed]
            relay = [sys.executable, "-m", "benchmarks.paper.relay", self._jitter, *seed]
            self._start(stack, "relay", relay).said("ready")
            delayed = ["battery_percentage"] if self._seed is None else [t for topics in LINKS.values() for t in topics]
            words += ["--ros-args", *(word for t in delayed for word in ("-r", f"/{t}:=/{t}_delayed"))]
        self._start(stack, "monitor", [sys.executable, "-m", "oracle_ros2", *words]).said("observing")

    def _start_node(self, stack: ExitStack, module: str, **parameters: object) -> Process:
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        return self._start(stack, module, [sys.executable, "-m", f"battery_uav.{module}", "--ros-args", *words])

    def _start(self, stack: ExitStack, name: str, command: Sequence[object], without: Sequence[str] = ()) -> Process:
        setting = os.environ | {
            "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}",
            "ROS_DOMAIN_ID": str(os.getpid() % 80 + 20),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOG_DIR": str(self._folder / "ros"),
        }
        process = Process(name, command, {k: v for k, v in setting.items() if k not in without})
        stack.callback(process.end)
        self._processes[name] = process
        return process
