"""A ROS master, a server, an adapter and ROS nodes, all processes of their own, for one test."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self
from xmlrpc.client import ServerProxy

from tests.forking import Forks
from tests.processes import PATIENCE, ROOT, Process, Server, as_yaml, environment, eventually, held_port
from tests.ros1 import peer
from tests.ros1.actionpeer import Behaviour, Ended

_SETTING = {"PYTHONUNBUFFERED": "1"}
_FORKS = Forks(Path(sys.executable), environment(**_SETTING), "oracle_ros1.program", "rospy", "actionlib")
_PEERS = multiprocessing.get_context("forkserver")
_PEERS.set_forkserver_preload([peer.__name__])


class Peer:
    """The test's side of a node in a process of its own."""

    def __init__(self, name: str, settings: dict[str, str]) -> None:
        self._connection, other = _PEERS.Pipe()
        self._process = _PEERS.Process(target=peer.main, args=(other, name, settings), daemon=True)
        self._process.start()
        other.close()
        self._calls = itertools.count()
        assert self._connection.poll(PATIENCE), "the node does not start"
        self._connection.recv()

    def record(self, kind: Any, topic: str, speakers: int = 0) -> None:
        """Hear a topic from now on, once so many publish it."""
        self._do("record", topic, kind)
        self.until(lambda: self._do("speakers", topic) >= speakers, lambda: f"nobody speaks on {topic}")

    def heard(self, topic: str, count: int = 0) -> list[Any]:
        """What it has heard of a topic, once there is so much of it."""
        self.until(lambda: self._do("count", topic) >= count, lambda: f"{self._do('count', topic)} came on {topic}")
        found: list[Any] = self._do("heard", topic)
        return found

    def advertise(self, kind: Any, topic: str, listeners: int = 1, latch: bool = False) -> None:
        """Get ready to publish, until so many hear it."""
        self._do("advertise", topic, kind, latch)
        self.until(lambda: self._do("listeners", topic) >= listeners, lambda: f"nobody hears {topic}")

    def withdraw(self, topic: str) -> None:
        """Publish a topic no more."""
        self._do("withdraw", topic)

    def publish(self, topic: str, *messages: Any, rate: float = 0) -> None:
        self._do("publish", topic, messages, rate)

    def serve(self, kind: Any, service: str, answer: Callable[[Any], Any]) -> None:
        """Serve by a function that can be pickled."""
        self._do("serve", service, kind, answer)

    def reached(self, service: str) -> list[Any]:
        found: list[Any] = self._do("reached", service)
        return found

    def begin(self, kind: Any, service: str, request: Any) -> int:
        """Call a service, and go on; tells the call's number."""
        number = next(self._calls)
        self._do("call", number, service, kind, request)
        return number

    def connect_service(self, kind: Any, service: str) -> None:
        """Have all calls of a service that is there on one connection."""
        self._do("connect_service", service, kind)

    def answer(self, number: int, wait: bool = True) -> peer.Answer | None:
        """What came of a call: the response, or the error's text."""
        if wait:
            self.until(lambda: self._do("answer", number), lambda: "the service does not answer")
        answer: peer.Answer | None = self._do("answer", number)
        return answer

    def call(self, kind: Any, service: str, request: Any) -> peer.Answer:
        answer = self.answer(self.begin(kind, service, request))
        assert answer is not None
        return answer

    def serve_action(self, kind: Any, name: str, behave: Behaviour) -> None:
        """Serve an action by a function that can be pickled."""
        self._do("serve_action", name, kind, behave)

    def goals(self, name: str, count: int = 0) -> list[str]:
        """The ids of the goals that have reached its server, once there are so many."""
        self.until(lambda: len(self._do("goals", name)) >= count, lambda: f"{self._do('goals', name)} came to {name}")
        found: list[str] = self._do("goals", name)
        return found

    def connect(self, kind: Any, name: str) -> None:
        """Be a client of an action, once its server is there."""
        self._do("connect", name, kind)
        self.until(lambda: self._do("connected", name), lambda: f"nobody serves {name}")

    def send_goal(self, name: str, goal: Any) -> tuple[int, str]:
        """Send a goal, and go on; tells what it is called by here, and its id."""
        number = next(self._calls)
        return number, self._do("send_goal", name, number, goal)

    def cancel_goal(self, number: int) -> None:
        self._do("cancel_goal", number)

    def cancel_all(self, name: str) -> None:
        self._do("cancel_all", name)

    def fed(self, number: int, count: int) -> None:
        """Wait until so much feedback has come for a goal."""
        self.until(lambda: self._do("feedback", number) >= count, lambda: f"{self._do('feedback', number)} came")

    def states(self, number: int) -> list[int]:
        """The states that a goal has gone through, as its client sees it."""
        found: list[int] = self._do("states", number)
        return found

    def ended(self, number: int, wait: bool = True) -> Ended | None:
        """What came of a goal."""
        if wait:
            self.until(lambda: self._do("ended", number), lambda: f"it is in {self._do('states', number)}")
        found: Ended | None = self._do("ended", number)
        return found

    def until(self, condition: Callable[[], object], what: Callable[[], str]) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, what()
            time.sleep(0.02)  # between two questions

    def parameter(self, name: str, value: object) -> None:
        """Set a parameter on the master."""
        self._do("parameter", name, value)

    def close(self) -> None:
        self._connection.close()
        self._process.join(5)
        self._process.kill()
        self._process.join()

    def _do(self, method: str, *arguments: Any) -> Any:
        self._connection.send((method, arguments))
        assert self._connection.poll(PATIENCE), f"{method} takes too long"
        return self._connection.recv()


class Scene:
    """A master and a server, with the processes and nodes that a test adds; at the end none is left."""

    def __init__(self, folder: Path, specs: Path = ROOT / "specs") -> None:
        self._folder, self._specs = folder, specs
        self._processes: list[Process] = []
        self._peers = itertools.count()

    def __enter__(self) -> Self:
        self._folder.mkdir(exist_ok=True)
        with ExitStack() as begun:  # undone where something does not start
            port = held_port(begun)
            self._stack = begun
            self.settings = {
                "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
                "ROS_IP": "127.0.0.1",
                "ROS_LOG_DIR": str(self._folder / "ros"),
                **_SETTING,
            }
            self._start_master()
            self.server = Server(self._specs, self._folder / "data", held_port(begun))
            begun.callback(self.server.kill)
            self._stack = begun.pop_all()
        return self

    def __exit__(self, failure: object, *_: object) -> None:
        if failure:
            for process in (self.server.process, *self._processes):
                print(f"== {process.name} said:\n{process.log}")
        self._stack.close()

    def _start_master(self) -> None:
        # Not by roscore: it gives the master 10 s to start, and two at once may both make ~/.ros.
        uri = self.settings["ROS_MASTER_URI"]
        self.master = self.run("rosmaster", "rosmaster", "--core", "-p", uri.rpartition(":")[2])
        eventually(lambda: _serves(uri), bool)

    def restart_master(self) -> None:
        """Have a master that knows of nobody."""
        self.master.remove()
        self._start_master()

    def run(self, name: str, *command: object) -> Process:
        """A program on ROS, removed at the end."""
        process = Process(name, command, environment(**self.settings), _FORKS)
        self._stack.callback(process.remove)
        self._processes.append(process)
        return process

    def adapter(self, spec: str, session: str = "s", monitor: str = "uav1", more: Sequence[str] = ()) -> Process:
        """An adapter that observes."""
        words = ("--oracle", self.server.url, "--spec", spec, "--session", session, "--monitor", monitor)
        python = os.environ.get("ADAPTER_PYTHON", sys.executable)  # such as a Python 3.8
        process = self.run("adapter", python, "-m", "oracle_ros1", *words, *more)
        process.said("observing")
        return process

    def node(self, module: str, package: str = "battery_uav", **parameters: object) -> Process:
        """One of an example's nodes."""
        words = [f"_{name}:={as_yaml(value)}" for name, value in parameters.items()]
        return self.run(module, sys.executable, "-m", f"{package}.{module}", *words)

    def peer(self) -> Peer:
        made = Peer(f"peer{next(self._peers)}", self.settings)
        self._stack.callback(made.close)
        return made


def _serves(uri: str) -> bool:
    """Whether there is a master."""
    with suppress(OSError), ServerProxy(uri) as master:
        return bool(master.getPid("/harness"))
    return False


__all__ = ["Peer", "Process", "Scene", "Server", "eventually"]
