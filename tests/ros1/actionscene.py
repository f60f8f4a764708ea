"""A graph with an action, for one test: what its servers do, its clients, and an adapter of an oracle of the test's."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from actionlib import msg

from tests.adapters.standin import described
from tests.processes import Data, Process
from tests.ros1.harness import Peer, Scene
from tests.ros1.judge import Decide, Judge, judge

KINDS = ("goal", "reply", "feedback", "cancel", "result", "status")


def streams(*kinds: str, ask: str = "", name: str = "/count", **more: Any) -> list[Data]:
    """An action of which some kinds are described, and some of these asked about."""
    whole: Data = {"proxy": f"{name}_mon", "via": "proxy", "denied_result": {"result": 9}, "fields": None, **more}
    return [
        described(name, kind, "actionlib/action/Test", action="filter" if kind in ask.split() else "log", **whole)
        for kind in kinds
    ]


@contextmanager
def watched(
    folder: Path, described: list[Data], decide: Decide = lambda _: None, module: str = "oracle_ros1"
) -> Iterator[tuple[Scene, Judge, Process]]:
    """A graph with an adapter of an oracle that the test makes up."""
    with judge(described, decide) as oracle, Scene(folder) as scene:
        yield scene, oracle, adapter(scene, oracle, module=module)


def adapter(scene: Scene, oracle: Judge, name: str = "uav1", module: str = "oracle_ros1") -> Process:
    words = ("--oracle", oracle.url, "--spec", "s", "--monitor", name)
    process = scene.run("adapter", sys.executable, "-m", module, *words)
    process.said("observing")
    return process


def client(scene: Scene, name: str = "/count_mon") -> Peer:
    peer = scene.peer()
    peer.connect(msg.TestAction, name)
    return peer


def server(scene: Scene, behave: Callable[[Any, threading.Event], None], name: str = "/count") -> Peer:
    peer = scene.peer()
    peer.serve_action(msg.TestAction, name, behave)
    return peer


def ids(events: list[Data]) -> list[str]:
    return [event["goal_id"] for event in events]


# What servers do


def count(goal: Any, _: threading.Event) -> None:
    """Count up to the goal, and say ten times as much."""
    goal.set_accepted()
    wanted = goal.get_goal().goal
    for number in range(1, wanted + 1):
        goal.publish_feedback(msg.TestFeedback(number))
    goal.set_succeeded(msg.TestResult(10 * wanted), "counted")


def count_fast(goal: Any, _: threading.Event) -> None:
    """Count at 500 Hz."""
    goal.set_accepted()
    due = time.monotonic()
    for number in range(1, goal.get_goal().goal + 1):
        goal.publish_feedback(msg.TestFeedback(number))
        due += 0.002
        time.sleep(max(0.0, due - time.monotonic()))
    goal.set_succeeded(msg.TestResult(0))


def last(goal: Any, cancelled: threading.Event) -> None:
    """Go on until the goal is cancelled."""
    goal.set_accepted()
    goal.publish_feedback(msg.TestFeedback(0))
    cancelled.wait()
    goal.set_canceled(msg.TestResult(1), "stopped")


def hesitate(goal: Any, cancelled: threading.Event) -> None:
    """Decide on a goal only once it is cancelled."""
    cancelled.wait()
    goal.set_canceled(msg.TestResult(2), "never begun")


def refuse(goal: Any, _: threading.Event) -> None:
    goal.set_rejected(msg.TestResult(), "no")


def until_asked(goal: Any, cancelled: threading.Event) -> None:
    """Succeed when it is cancelled: late enough for a test to do something in between."""
    goal.set_accepted()
    cancelled.wait()
    goal.set_succeeded(msg.TestResult(3), "done all the same")
