"""A ROS node in a process of its own, which does what a test says and tells what it heard."""

from __future__ import annotations

import os
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

import rospy

from tests.ros1.actionpeer import ActionSide, reaches

Answer = tuple[Any, str | None]
"""What a service answered, or its error."""


class Node(ActionSide):
    """The node's side: each method can be called from the test's process, with what can be pickled."""

    def __init__(self) -> None:
        super().__init__()
        self._heard: dict[str, list[Any]] = defaultdict(list)
        self._subscribers: dict[str, rospy.Subscriber] = {}
        self._publishers: dict[str, rospy.Publisher] = {}
        self._reached: dict[str, list[Any]] = defaultdict(list)
        self._answers: dict[int, Answer] = {}
        self._connected: dict[str, rospy.ServiceProxy] = {}

    def record(self, topic: str, kind: Any) -> None:
        """Hear a topic from now on."""
        heard = self._heard[topic]
        self._subscribers[topic] = rospy.Subscriber(topic, kind, heard.append, tcp_nodelay=True)

    def speakers(self, topic: str) -> int:
        """How many publishers would reach it with what they say on a topic from now on."""
        return sum(reaches(connection.endpoint_id, topic) for connection in self._subscribers[topic].impl.connections)

    def heard(self, topic: str) -> list[Any]:
        """What was heard so far."""
        return list(self._heard[topic])

    def count(self, topic: str) -> int:
        """How many were heard so far."""
        return len(self._heard[topic])

    def advertise(self, topic: str, kind: Any, latch: bool) -> None:
        self._publishers[topic] = rospy.Publisher(topic, kind, latch=latch, tcp_nodelay=True, queue_size=100_000)

    def withdraw(self, topic: str) -> None:
        self._publishers.pop(topic).unregister()

    def listeners(self, topic: str) -> int:
        return int(self._publishers[topic].get_num_connections())

    def publish(self, topic: str, messages: Sequence[Any], rate: float) -> None:
        """Publish so many a second, or as fast as it goes."""
        due = time.monotonic()
        for message in messages:
            self._publishers[topic].publish(message)
            if rate:
                due += 1 / rate
                time.sleep(max(0.0, due - time.monotonic()))

    def parameter(self, name: str, value: Any) -> None:
        rospy.set_param(name, value)

    def serve(self, service: str, kind: Any, answer: Callable[[Any], Any]) -> None:
        reached = self._reached[service]

        def handle(request: Any) -> Any:
            reached.append(request)
            return answer(request)

        rospy.Service(service, kind, handle)

    def reached(self, service: str) -> list[Any]:
        """The requests that have reached a service."""
        return list(self._reached[service])

    def connect_service(self, service: str, kind: Any) -> None:
        """Have all calls of a service on one connection, which its first call makes."""
        self._connected[service] = rospy.ServiceProxy(service, kind, persistent=True)

    def call(self, number: int, service: str, kind: Any, request: Any) -> None:
        """Call a service, in a thread of its own."""

        def work() -> None:
            try:
                connected = self._connected.get(service)
                if connected is None:
                    rospy.wait_for_service(service)
                self._answers[number] = (connected or rospy.ServiceProxy(service, kind))(request), None
            except rospy.ServiceException as error:
                self._answers[number] = None, str(error)

        threading.Thread(target=work, daemon=True).start()

    def answer(self, number: int) -> Answer | None:
        """What came of a call, None while it waits."""
        return self._answers.get(number)


def main(connection: Connection, name: str, environment: dict[str, str]) -> None:
    """Do what comes, until nothing can come any more."""
    os.environ.update(environment)
    rospy.init_node(name, disable_signals=True)
    node = Node()
    connection.send(None)
    while True:
        try:
            method, arguments = connection.recv()
        except (EOFError, OSError):
            break
        connection.send(getattr(node, method)(*arguments))
    os._exit(0)  # the master ends too, and need not be told
