"""Algorithm 1 of the ROSMonitoring 2.0 paper, as it is written there, over recorded arrivals.

A message is released only while every topic has one buffered; messages are kept by their time stamps.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Arrival:
    """A message of a buffer (a topic, or a service with its requests and responses); times in nanoseconds."""

    buffer: str
    stamp: int
    arrived: int
    kind: str = "topic"


class Algorithm1:
    """`add_to_buffer` and `send_earliest_message_to_oracle`; what is sent goes to `released`, with the time."""

    def __init__(self, buffers: Iterable[str]) -> None:
        self.released: dict[Arrival, int] = {}
        self._buffer: dict[str, list[int]] = {name: [] for name in buffers}
        self._messages: dict[int, Arrival] = {}

    def add_to_buffer(self, message: Arrival, now: int) -> None:
        self._buffer[message.buffer].append(message.stamp)
        self._messages[message.stamp] = message  # one of the same stamp is lost
        while all(self._buffer.values()) and self._messages:
            self._send_earliest(now)

    def interrupt(self, now: int) -> None:
        """At the end of a run what is left is released in order, without waiting for all buffers."""
        while self._messages:
            self._send_earliest(now)

    def _send_earliest(self, now: int) -> None:
        stamp = min(self._messages)
        message = self._messages.pop(stamp)
        if stamp in self._buffer[message.buffer]:
            self._buffer[message.buffer].remove(stamp)
        self.released[message] = now


def replay(arrivals: Iterable[Arrival]) -> dict[Arrival, int]:
    """When Algorithm 1 releases each message of a recorded run (ns); lost ones are missing."""
    found = sorted(arrivals, key=lambda a: a.arrived)
    algorithm = Algorithm1(sorted({a.buffer for a in found}))
    for arrival in found:
        algorithm.add_to_buffer(arrival, arrival.arrived)
    if found:
        algorithm.interrupt(found[-1].arrived)
    return algorithm.released


def never_released(arrivals: Iterable[Arrival], waits: Callable[[Arrival, Arrival], bool]) -> list[Arrival]:
    """The requests that Algorithm 1 never releases where it decides itself what may pass: a deadlock.

    `waits(later, request)` says that a message could not have come before that request was released: its response,
    and what the caller says after it. Such messages come as they came, but not before.
    """
    coming = deque(sorted(arrivals, key=lambda a: a.arrived))
    algorithm = Algorithm1(sorted({a.buffer for a in coming}))
    open_requests: list[Arrival] = []
    kept_back: list[Arrival] = []
    while coming:
        arrival = coming.popleft()
        if any(waits(arrival, request) for request in open_requests):
            kept_back.append(arrival)
            continue
        algorithm.add_to_buffer(arrival, arrival.arrived)
        if arrival.kind == "request":
            open_requests.append(arrival)
        still_open = [r for r in open_requests if r not in algorithm.released]
        if still_open != open_requests:
            open_requests = still_open
            coming.extendleft(reversed(kept_back))
            kept_back.clear()
    return open_requests
