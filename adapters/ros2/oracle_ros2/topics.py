"""Topics: those that are only observed, and those whose messages pass when the oracle allows it."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, Any, Mapping

from oracle_adapter import PROXY, Answer, Board, Link

from oracle_ros2.codec import load_type, reader
from oracle_ros2.qos import Matched
from oracle_ros2.stamps import simulated, stamp_reader, time_of

if TYPE_CHECKING:
    from concurrent.futures import Future

    from oracle_adapter import Names
    from rclpy.node import Node


class Observed:
    """A topic as its messages arrive: their stamp, their publisher, what was missed, and the fields that are read."""

    def __init__(self, node: Node, stream: Mapping[str, Any]) -> None:
        # the middleware's time is the wall's: in a simulation the time of arrival comes nearer
        self._now = time_of(node) if simulated(node) else None
        self.name: str = stream["name"]
        self.type = load_type(stream["type"])
        self._stamp = stamp_reader(self.type, stream["stamp"])
        self._read = reader(self.type, stream["fields"])
        self._numbers: dict[str, int] = {}

    def event(self, message: Any, info: Mapping[str, Any]) -> tuple[int | None, Any, dict[str, Any]]:
        """The stamp (ns), the data and the rest of a message's event."""
        source = str(info.get("publisher_gid", ""))
        stamp = self._stamp(message) or (self._now() if self._now else info["source_timestamp"]) or None
        return stamp, self._read(message), {"source": source, "lost": self._missed(source, info)}

    def _missed(self, source: str, info: Mapping[str, Any]) -> int:
        """How many messages of a publisher were lost just before this one, as its sequence numbers tell."""
        number = info.get("publication_sequence_number")
        if number is None:
            return 0
        before = self._numbers.get(source)
        self._numbers[source] = number
        return 0 if before is None else max(0, number - before - 1)


class LoggedTopic:
    """Reports every message of a topic."""

    def __init__(self, node: Node, link: Link, names: Names, stream: Mapping[str, Any]) -> None:
        self._link = link
        self._observed = Observed(node, stream)
        self.matched = Matched(node, self._observed.type, names[self._observed.name], self._take)

    def _take(self, message: Any, info: Mapping[str, Any]) -> None:
        stamp, data, more = self._observed.event(message, info)
        self._link.send(self._observed.name, "topic", stamp, data, **more)


class FilteredTopic:
    """Forwards the messages that the oracle allows, in their order; no callback waits for a decision.

    `intercept: publisher` takes X_mon and gives X, `subscriber` takes X and gives X_mon.
    """

    def __init__(self, node: Node, link: Link, board: Board, names: Names, stream: Mapping[str, Any]) -> None:
        self._link, self._board, self._stream = link, board, stream
        self._observed = Observed(node, stream)
        plain, beside = names[self._observed.name], names[self._observed.name + PROXY]
        source, target = (beside, plain) if stream["intercept"] == "publisher" else (plain, beside)
        self._waiting: deque[tuple[Any, Future[Answer]]] = deque()
        self._forwarding = threading.Lock()
        self._publisher = node.create_publisher(self._observed.type, target, 1000)
        self.matched = Matched(node, self._observed.type, source, self._take)

    def _take(self, message: Any, info: Mapping[str, Any]) -> None:
        stamp, data, more = self._observed.event(message, info)
        within = self._stream["decide_within"] / 10**9
        answer = self._link.ask(self._observed.name, "topic", stamp, data, decide_within=within, **more)
        self._waiting.append((message, answer))
        answer.add_done_callback(lambda _: self._forward())

    def _forward(self) -> None:
        """Settle the messages at the head of the queue whose answers are there."""
        with self._forwarding:
            while self._waiting and self._waiting[0][1].done():
                message, future = self._waiting.popleft()
                answer = future.result()
                event = f"a message of {self._observed.name}"
                passed, why = self._board.settle(answer, self._stream["on_unavailable"], event)
                if passed:
                    self._publisher.publish(message)
                self._link.outcome(answer, passed, why)
