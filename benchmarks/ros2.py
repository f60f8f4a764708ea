"""What the oracle costs on ROS 2: a filtered topic and a proxied service, beside the direct ones and a bare chain.

    source .build/ros2/setup.sh && python benchmarks/ros2.py [--rounds 2] [--json]

The bare chain has the same hops and no logic: rclpy in, a WebSocket echo in another process, rclpy out; its link has a
thread of its own, as the adapter's has. Everything runs in processes of its own, on this machine, one path after the
other, round by round. Latency is from before a message is published, or a service called, until it is there.
"""

from __future__ import annotations

import argparse
import asyncio
import importlib
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SERVER = ROOT / ".build" / "server" / "bin" / "oracle-server"
ROS_ONLY = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
PATIENCE = 30.0
DEPTH = 2000
RATES = (100, 1000)
SECONDS = 2.0
CALLS = 200
WARM_UP = -1
GOAL_P50, GOAL_P99 = 1.3, 1.5

SPECS = """
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
---
id: service
description: Every request and response is asked for, and passes
streams:
  - service: /switch
    type: std_srvs/srv/SetBool
    action: filter
    request: {signals: {on: msg.data}}
    response: {signals: {text: msg.message}}
properties:
  - id: no_nonsense
    formula: 'not {service: "/switch", text: "nonsense"}'
    guards: [/switch]
"""


# The parts, each a process


def ros(name: str) -> tuple[Any, Any]:
    """A node and its executor."""
    rclpy = importlib.import_module("rclpy")
    rclpy.init()
    node = rclpy.create_node(name)
    executor = importlib.import_module("rclpy.executors").SingleThreadedExecutor()
    executor.add_node(node)
    return node, executor


def number_type() -> Any:
    return importlib.import_module("std_msgs.msg").Int64


def switch_type() -> Any:
    return importlib.import_module("std_srvs.srv").SetBool


def say(word: str) -> None:
    print(word, flush=True)


def told() -> deque[str]:
    """The lines that this process is told, as they come."""
    lines: deque[str] = deque()

    def follow() -> None:
        lines.extend(sys.stdin)  # one by one

    threading.Thread(target=follow, daemon=True).start()
    return lines


def send(rate: int) -> None:
    """Publish to warm up until told, and then at the rate."""
    node, _ = ros("sender")
    publisher = node.create_publisher(number_type(), "/number", DEPTH)
    lines = told()
    while not lines:
        publisher.publish(number_type()(data=WARM_UP))
        time.sleep(0.02)
    time.sleep(0.2)
    due = time.monotonic()
    for _ in range(int(rate * SECONDS)):
        time.sleep(max(0.0, due - time.monotonic()))
        publisher.publish(number_type()(data=time.monotonic_ns()))
        due += 1 / rate
    say("sent")
    wait(lambda: len(lines) > 1)


def receive(topic: str, wanted: int) -> None:
    """Tell that something came; then, when all is there or nothing more comes, the latencies."""
    node, executor = ros("receiver")
    latencies: list[float] = []
    warm: list[bool] = []

    def hear(message: Any) -> None:
        now = time.monotonic_ns()
        if message.data != WARM_UP:
            latencies.append((now - message.data) / 1e6)
        elif not warm:
            warm.append(True)
            say("heard")

    node.create_subscription(number_type(), topic, hear, DEPTH)
    lines = told()
    patience = math.inf
    while len(latencies) < wanted and time.monotonic() < patience:
        executor.spin_once(timeout_sec=0.1)
        if lines and patience == math.inf:
            patience = time.monotonic() + 3.0
    say(json.dumps(latencies))


def serve() -> None:
    """The service itself."""
    node, executor = ros("server")
    node.create_service(switch_type(), "/switch", lambda _request, response: response)
    say("ready")
    spin(executor)


def call(service: str) -> None:
    """Call one after the other, and tell the latencies."""
    node, executor = ros("caller")
    client = node.create_client(switch_type(), service)
    assert client.wait_for_service(PATIENCE)
    latencies = []
    for number in range(CALLS + 20):
        began = time.monotonic_ns()
        answer = client.call_async(switch_type().Request(data=True))
        executor.spin_until_future_complete(answer, PATIENCE)
        assert answer.done()
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
        async with client.connect(f"ws://127.0.0.1:{self._port}", compression=None, proxy=None) as socket:
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


def bare(port: int) -> None:
    """The chain without logic, for the topic and the service."""
    node, executor = ros("bare")
    link = BareLink(port)
    publisher = node.create_publisher(number_type(), "/number_mon", DEPTH)

    def take(message: Any) -> None:
        link.ask(json.dumps({"data": message.data}), lambda: publisher.publish(message))

    node.create_subscription(number_type(), "/number", take, DEPTH)
    group = importlib.import_module("rclpy.callback_groups").ReentrantCallbackGroup()
    client = node.create_client(switch_type(), "/switch", callback_group=group)
    future = importlib.import_module("rclpy.task").Future

    async def passes(data: dict[str, Any]) -> None:
        settled = future(executor=executor)

        def settle() -> None:
            settled.set_result(None)
            executor.wake()

        link.ask(json.dumps(data), settle)
        await settled

    async def pass_on(request: Any, _response: Any) -> Any:
        await passes({"data": request.data})
        while not client.service_is_ready():  # at first
            await passes({})
        response = await client.call_async(request)
        await passes({"success": response.success, "message": response.message})
        return response

    node.create_service(switch_type(), "/switch_mon", pass_on, callback_group=group)
    say("ready")
    spin(executor)


def spin(executor: Any) -> None:
    while True:
        executor.spin_once(timeout_sec=0.1)


PARTS: dict[str, Callable[..., None]] = {
    "send": lambda rate: send(int(rate)),
    "receive": lambda topic, wanted: receive(topic, int(wanted)),
    "serve": serve,
    "call": call,
    "echo": echo,
    "bare": lambda port: bare(int(port)),
}


# The run


class Part:
    """A process; its lines are read as they are wanted."""

    def __init__(self, command: list[object], setting: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            [str(word) for word in command],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=setting,
        )  # fmt: skip

    def until(self, pattern: str) -> re.Match[str]:
        """Read up to a line that has the pattern; the process is ended where that takes too long."""
        assert self._process.stdout is not None
        seen = []
        impatient = threading.Timer(PATIENCE, self._process.kill)
        impatient.start()
        try:
            for line in self._process.stdout:
                match = re.search(pattern, re.sub(r"\x1b\[[0-9;]*m", "", line))
                if match:
                    return match
                seen.append(line)
        finally:
            impatient.cancel()
        raise SystemExit(f"no {pattern!r} in {PATIENCE} s: {''.join(seen[-20:])}")

    def tell(self, word: str) -> None:
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write(word + "\n")
            self._process.stdin.flush()

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()


@dataclass
class Measured:
    """Latencies in ms of one path."""

    sent: int = 0
    latencies: list[float] = field(default_factory=list)

    def quantile(self, share: float) -> float:
        ordered = sorted(self.latencies)
        return ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)] if ordered else math.nan

    @property
    def lost(self) -> int:
        return self.sent - len(self.latencies)


class Run:
    """One benchmark: a domain, a folder, and what was measured of each case on each path."""

    def __init__(self, folder: Path) -> None:
        self.measured: dict[tuple[str, str], Measured] = {}
        self._folder = folder
        self._setting = os.environ | {
            "ROS_DOMAIN_ID": str(os.getpid() % 80 + 20),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOG_DIR": str(folder / "ros"),
        }
        (folder / "specs").mkdir()
        for text in SPECS.split("---\n"):
            name = text.split("id: ")[1].split("\n")[0]
            (folder / "specs" / f"{name}.yaml").write_text(text)

    def round(self) -> None:
        for path, chain in (("direct", self._direct), ("bare", self._bare), ("oracle", self._oracle)):
            for rate in RATES:
                with chain("topic"):
                    self._measure_topic(path, rate)
            with chain("service"):
                self._measure_service(path)

    def _part(self, stack: ExitStack, *words: object) -> Part:
        return self._start(stack, [sys.executable, __file__, "--part", *words])

    def _start(self, stack: ExitStack, command: list[object], without: tuple[str, ...] = ()) -> Part:
        part = Part(command, {k: v for k, v in self._setting.items() if k not in without})
        stack.callback(part.end)
        return part

    @contextmanager
    def _direct(self, _what: str) -> Iterator[None]:
        yield

    @contextmanager
    def _bare(self, _what: str) -> Iterator[None]:
        with ExitStack() as stack:
            port = self._part(stack, "echo").until(r"port=(\d+)")[1]
            self._part(stack, "bare", port).until("ready")
            yield

    @contextmanager
    def _oracle(self, what: str) -> Iterator[None]:
        with ExitStack() as stack:
            data = tempfile.mkdtemp(dir=self._folder)
            command = [SERVER, "serve", "--specs", self._folder / "specs", "--data-dir", data, "--port", "0"]
            url = self._start(stack, command, ROS_ONLY).until(r"url=(http://\S+)")[1]
            adapter = [sys.executable, "-m", "oracle_ros2", "--oracle", url, "--spec", what]
            self._start(stack, adapter).until("observing")
            yield

    def _measure_topic(self, path: str, rate: int) -> None:
        wanted = int(rate * SECONDS)
        with ExitStack() as stack:
            receiver = self._part(stack, "receive", "/number" if path == "direct" else "/number_mon", wanted)
            sender = self._part(stack, "send", rate)
            receiver.until("heard")
            sender.tell("go")
            sender.until("sent")
            receiver.tell("stop")
            latencies = json.loads(receiver.until(r"^\[.*\]$")[0])
            sender.tell("end")
        self._add(f"topic at {rate} Hz", path, wanted, latencies)

    def _measure_service(self, path: str) -> None:
        with ExitStack() as stack:
            self._part(stack, "serve").until("ready")
            caller = self._part(stack, "call", "/switch" if path == "direct" else "/switch_mon")
            latencies = json.loads(caller.until(r"^\[.*\]$")[0])
        self._add("service", path, CALLS, latencies)

    def _add(self, case: str, path: str, sent: int, latencies: list[float]) -> None:
        measured = self.measured.setdefault((case, path), Measured())
        measured.sent += sent
        measured.latencies += latencies


def wait(condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)


def rows(run: Run) -> list[dict[str, Any]]:
    found = []
    for (case, path), measured in sorted(run.measured.items(), key=lambda item: item[0][0]):
        bare_chain = run.measured[case, "bare"]
        found.append(
            {
                "case": case,
                "path": path,
                "sent": measured.sent,
                "lost": measured.lost,
                "p50_ms": round(measured.quantile(0.5), 3),
                "p99_ms": round(measured.quantile(0.99), 3),
                "p50_ratio": round(measured.quantile(0.5) / bare_chain.quantile(0.5), 2),
                "p99_ratio": round(measured.quantile(0.99) / bare_chain.quantile(0.99), 2),
            }
        )
    return found


def verdict(row: dict[str, Any]) -> str:
    if row["path"] != "oracle":
        return ""
    good = row["p50_ratio"] <= GOAL_P50 and row["p99_ratio"] <= GOAL_P99 and row["lost"] == 0
    return "met" if good else "missed"


def table(found: list[dict[str, Any]]) -> None:
    print(
        f"{'':17}{'path':8}{'sent':>6}{'lost':>6}{'p50 ms':>9}{'p99 ms':>9}{'p50 x bare':>12}{'p99 x bare':>12}  goal"
    )
    for row in found:
        print(
            f"{row['case']:17}{row['path']:8}{row['sent']:6}{row['lost']:6}{row['p50_ms']:9.3f}{row['p99_ms']:9.3f}"
            f"{row['p50_ratio']:12.2f}{row['p99_ratio']:12.2f}  {verdict(row)}"
        )
    print(f"goal: p50 <= {GOAL_P50} x and p99 <= {GOAL_P99} x the bare chain, and none lost")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="one JSON document instead of a table")
    parser.add_argument("--part", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        PARTS[options.part[0]](*options.part[1:])
        return
    before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(prefix="oracle-benchmark.") as folder:
        run = Run(Path(folder))
        for _ in range(options.rounds):
            run.round()
    found = rows(run)
    if options.json:
        print(json.dumps({"cpus": os.cpu_count(), "load_before": before, "rows": found}))
        return
    table(found)
    print(f"{os.cpu_count()} CPUs; load before the run {before:.1f}")


if __name__ == "__main__":
    main()
