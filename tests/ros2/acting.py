"""An action server, an adapter that proxies it, and a judge by whose word it does; and clients of this process."""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.adapters.judge import Judge, judge
from tests.adapters.standin import described
from tests.processes import Data, Process
from tests.ros2.harness import Peer, Scene

action = pytest.importorskip("rclpy.action")
qos = pytest.importorskip("rclpy.qos")
test_msgs = pytest.importorskip("test_msgs.action")
action_msgs = pytest.importorskip("action_msgs.msg")
action_srvs = pytest.importorskip("action_msgs.srv")

KINDS = ("goal", "reply", "feedback", "cancel", "result", "status")
FIELDS = {"goal": ["order"], "reply": ["accepted"], "feedback": ["sequence"], "result": ["sequence"]}
SUCCEEDED, CANCELED, ABORTED, UNKNOWN = 4, 5, 6, 0
DENIED = {"sequence": [9, 9]}


def streams(*asked: str, via: str = "proxy", kinds: tuple[str, ...] = KINDS, **more: Any) -> list[Data]:
    """Those of /fib, of which some are asked about."""
    return [
        described(
            "/fib", kind, "test_msgs/action/Fibonacci", action="filter" if kind in asked else "log", via=via,
            proxy="/fib_mon" if via == "proxy" else "", denied_result=DENIED, fields=FIELDS.get(kind, []), **more,
        )
        for kind in kinds
    ]  # fmt: skip


class Acting:
    """All of it."""

    def __init__(self, scene: Scene, judge: Judge, module: str) -> None:
        self.scene, self.judge, self._module = scene, judge, module
        self.adapter = self.monitor()

    def monitor(self, name: str = "uav1", judge: Judge | None = None) -> Process:
        """An adapter that has begun to observe, for this judge or another."""
        words = ("--oracle", (judge or self.judge).url, "--spec", "s", "--monitor", name)
        adapter = self.scene.run("adapter", sys.executable, "-m", self._module, *words)
        adapter.said("observing")
        return adapter

    def server(self, period: float = 0.01, *more: object) -> Process:
        """The action's server."""
        server = self.scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", period, *more)
        server.said("ready")
        return server

    def observed(self, *more: str) -> Client:
        """A client of the action itself, whose server the adapter has found."""
        self.scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", 0.01, 10, *more)
        client = self.client("/fib")
        wanted = {"goal", "reply", "result", "status"} if more else {"status"}

        def came(future: Any) -> bool:  # a client that the server has not discovered yet gets no answer
            late = time.monotonic() + 5
            client.peer.until(lambda: future.done() or time.monotonic() > late)
            return bool(future.done())

        def heard() -> bool:
            sent = client.send(0)
            seen = came(sent) and came(sent.result().get_result_async())
            return seen and wanted <= {event["kind"] for event in list(self.judge.seen)}

        client.peer.until(heard, "the server is not observed")
        return client

    def client(self, name: str = "/fib_mon", depth: int = 1000) -> Client:
        """A client, on a node of its own."""
        return Client(self.scene.peer(), name, depth)


class Client:
    """A client of the action, and what it is told."""

    def __init__(self, peer: Peer, name: str, depth: int) -> None:
        self.peer, self.name = peer, name
        profile = qos.QoSProfile(depth=depth)
        self.client = action.ActionClient(peer.node, test_msgs.Fibonacci, name, feedback_sub_qos_profile=profile)
        peer.made.append(self.client)
        peer.until(self.client.server_is_ready, f"nobody serves {name}")
        self.heard: dict[str, list[int]] = defaultdict(list)
        """The feedback of each goal: rclpy's client itself drops what a result overtakes there."""
        self._fed: set[str] = set()
        message = test_msgs.Fibonacci.Impl.FeedbackMessage
        self._ear = peer.node.create_subscription(message, f"{name}/_action/feedback", self._hear, depth)

    def _hear(self, message: Any) -> None:
        self.heard[bytes(message.goal_id.uuid).hex()].append(message.feedback.sequence[0])

    def send(self, order: int) -> Any:
        """A goal that is on its way."""

        def hear(message: Any) -> None:
            self._fed.add(bytes(message.goal_id.uuid).hex())

        return self.client.send_goal_async(test_msgs.Fibonacci.Goal(order=order), hear)

    def done(self, future: Any, what: str = "there is no answer") -> Any:
        """What came of something."""
        self.peer.until(future.done, what)
        return future.result()

    def goal(self, order: int) -> Any:
        """A goal that has its reply."""
        return self.done(self.send(order), "there is no reply")

    def result(self, goal: Any) -> tuple[int, list[int]]:
        """How a goal ended, and with what."""
        found = self.done(goal.get_result_async(), "there is no result")
        return found.status, list(found.result.sequence)

    def meet(self) -> None:
        """Wait until feedback comes all the way: at first what is not discovered yet hears nothing."""

        def heard() -> bool:
            goal = self.goal(1)
            self.result(goal)
            return hex_of(goal) in self._fed and hex_of(goal) in self.heard

        self.peer.until(heard, "no feedback comes")

    def leave(self) -> None:
        """Be there no more."""
        self.peer.made.remove(self.client)
        self.client.destroy()
        self.peer.node.destroy_subscription(self._ear)

    def cancel(self, goal_id: bytes = bytes(16), stamp: int = 0) -> Any:
        """The answer to a cancel, of all goals unless one is named, or a time (ns) that they came by."""
        client = self.peer.node.create_client(action_srvs.CancelGoal, f"{self.name}/_action/cancel_goal")
        self.peer.until(client.service_is_ready)
        request = action_srvs.CancelGoal.Request()
        request.goal_info.goal_id.uuid = list(goal_id)
        request.goal_info.stamp.sec, request.goal_info.stamp.nanosec = divmod(stamp, 10**9)
        return self.done(client.call_async(request))


def hex_of(goal: Any) -> str:
    return bytes(goal.goal_id.uuid).hex()


@contextmanager
def acting(folder: Path, described: list[Data], module: str = "oracle_ros2") -> Iterator[Acting]:
    """An adapter that observes these streams."""
    with judge(described) as judging, Scene(folder) as scene:
        yield Acting(scene, judging, module)
