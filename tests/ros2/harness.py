"""A server, an adapter and ROS nodes as processes in a ROS domain of their own, and a node of this process there."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import pytest

from tests.forking import Forks
from tests.processes import (
    PATIENCE,
    ROOT,
    Data,
    Process,
    Server,
    as_yaml,
    environment,
    eventually,
    held_port,
    without_gaps,
)

rclpy = pytest.importorskip("rclpy")
executors = pytest.importorskip("rclpy.executors")

__all__ = ["Data", "Peer", "Process", "Scene", "Server", "eventually", "without_gaps"]

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


class Peer:
    """A node of this process; it is spun while a test waits, by `until`."""

    def __init__(self, domain: int, name: str = "peer") -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node(name, context=self.context)
        self._executor = executors.SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.made: list[Any] = []
        """What must be destroyed before the node, or its context would live on."""

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
        for one in self.made:
            one.destroy()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


_FORKS = Forks(Path(sys.executable), environment(), "oracle_ros2.program", "rclpy.action")


class Scene:
    """A domain and a server, with the processes and nodes that a test adds; at the end none is left."""

    def __init__(self, folder: Path, specs: Path = ROOT / "specs") -> None:
        self._folder, self._specs = folder, specs
        self._processes: list[Process] = []
        self._peers = ExitStack()

    def __enter__(self) -> Self:
        self._folder.mkdir(exist_ok=True)
        with ExitStack() as begun:  # undone where the server does not start
            self.domain = self._free_domain(begun)
            self.server = Server(self._specs, self._folder / "data", held_port(begun))
            begun.callback(self.server.kill)
            self._stack = begun.pop_all()
        return self

    def __exit__(self, failure: object, *_: object) -> None:
        with self._stack:  # the peers first: Fast DDS may crash a participant that ends just when others were killed
            self._peers.close()
        if failure:
            for process in (self.server.process, *self._processes):
                print(f"== {process.name} said:\n{process.log}")

    def run(self, name: str, *command: object) -> Process:
        """A program on ROS, removed at the end."""
        settings = environment(ROS_DOMAIN_ID=str(self.domain), ROS_LOG_DIR=str(self._folder / "ros"))
        process = Process(name, command, settings, _FORKS)
        self._stack.callback(process.remove)
        self._processes.append(process)
        return process

    def adapter(self, spec: str, session: str = "s", monitor: str = "uav1", more: Sequence[str] = ()) -> Process:
        """An adapter that observes; `more` are more of its arguments."""
        words = ("--oracle", self.server.url, "--spec", spec, "--session", session, "--monitor", monitor, *more)
        process = self.run("adapter", sys.executable, "-m", "oracle_ros2", *words)
        process.said("observing")
        return process

    def node(self, module: str, package: str = "battery_uav", **parameters: object) -> Process:
        """One of an example's nodes."""
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={as_yaml(value)}")]
        return self.run(module, sys.executable, "-m", f"{package}.{module}", "--ros-args", *words)

    def peer(self, name: str = "peer") -> Peer:
        peer = Peer(self.domain, name)
        self._peers.callback(peer.close)
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
