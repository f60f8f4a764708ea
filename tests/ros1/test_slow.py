"""What waits for a subscriber that hangs, in rospy's own queue."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from oracle_ros1 import slow
from rospy.impl.tcpros_pubsub import QueuedConnection

MEGABYTE = 10**6


class Hanging:
    """A connection to a subscriber that takes nothing until it ends."""

    def __init__(self) -> None:
        self.done = False
        self.taken, self._ended = threading.Event(), threading.Event()
        self.on_end: Callable[[Any], None] = lambda _: None

    def set_cleanup_callback(self, call: Callable[[Any], None]) -> None:
        self.on_end = call

    def write_data(self, _: bytes) -> None:
        self.taken.set()
        self._ended.wait()

    def end(self) -> None:
        self.done = True
        self._ended.set()
        self.on_end(self)


@pytest.fixture
def queue() -> Iterator[Any]:
    hanging = Hanging()
    made = QueuedConnection(hanging, slow.DEPTH)
    made.write_data(b"first")
    assert hanging.taken.wait(60)  # it is stuck with this one: what comes now waits
    yield made
    hanging.end()
    made._thread.join(60)


def give(queue: Any, *messages: bytes) -> list[bytes]:
    """What waits once these were given."""
    publisher = SimpleNamespace(impl=SimpleNamespace(connections=[queue]))
    for message in messages:
        queue.write_data(message)
        slow.keep_room(publisher, len(message))
    return list(queue._queue)


def test_of_large_messages_as_many_wait_as_there_is_room_for_and_the_newest(queue: Any) -> None:
    messages = [bytes([n % 256]) * MEGABYTE for n in range(300)]
    waiting = give(queue, *messages)
    assert waiting == messages[-len(waiting) :]
    assert sum(map(len, waiting)) <= slow.ROOM < sum(map(len, waiting)) + MEGABYTE


def test_a_few_wait_whatever_they_take(queue: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slow, "ROOM", MEGABYTE)
    assert len(give(queue, *[bytes(MEGABYTE)] * 30)) == slow.FEW


def test_small_messages_wait_as_rospy_has_it(queue: Any) -> None:
    assert len(give(queue, *[b"small"] * (slow.DEPTH + 5))) == slow.DEPTH


def test_a_publisher_that_has_ended_has_none_that_wait() -> None:
    slow.keep_room(SimpleNamespace(impl=None), slow.ROOM)
    slow.keep_room(SimpleNamespace(impl=SimpleNamespace(connections=None)), slow.ROOM)
