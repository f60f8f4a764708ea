"""Topics: those that are only observed, and those whose messages pass when the oracle allows it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Mapping

from oracle_adapter import PROXY, Board, Link
from oracle_adapter.passing import Gate, Passing

from oracle_ros2.codec import load_type, reader
from oracle_ros2.endpoints import Forwarded, Heard
from oracle_ros2.stamps import simulated, stamp_reader, time_of

if TYPE_CHECKING:
    from oracle_adapter import Names
    from oracle_adapter.protocol import TimeSource
    from rclpy.node import Node


class Observed:
    """A topic as its messages arrive: their stamp, their publisher, what was missed, and the fields that are read."""

    def __init__(self, node: Node, stream: Mapping[str, Any]) -> None:
        # the middleware's time is the wall's: in a simulation the time of arrival comes nearer
        self._now = time_of(node) if simulated(node) else None
        self.name: str = stream["name"]
        self.type = load_type(stream["type"])
        self._stamp = stamp_reader(self.type, stream["stamp"])
        self.time_source: TimeSource = "field" if self._stamp else "arrival" if self._now else "middleware"
        self._read = reader(self.type, stream["fields"])
        self._numbers: dict[str, int] = {}
        self.count = 0
        """How many messages have come."""

    def event(self, message: Any, info: Mapping[str, Any]) -> tuple[int | None, Any, dict[str, Any]] | None:
        """The stamp (ns), the data and the rest of a message's event; None where it came before."""
        self.count += 1
        publisher = info.get("publisher_gid")
        source = publisher["data"].hex() if publisher else ""
        missed = self._missed(source, info)
        if missed < 0:
            return None
        stamp = (
            (self._stamp and self._stamp(message)) or (self._now() if self._now else info["source_timestamp"]) or None
        )
        return stamp, self._read(message), {"source": source, "lost": missed}

    def _missed(self, source: str, info: Mapping[str, Any]) -> int:
        """How many messages of a publisher were lost just before this one, as its numbers tell; -1 where it is old."""
        number = info.get("publication_sequence_number")
        if number is None:
            return 0
        before = self._numbers.get(source, number - 1)
        self._numbers[source] = max(number, before)
        return max(-1, number - before - 1)


class LoggedTopic:
    """Reports every message of a topic."""

    def __init__(self, node: Node, link: Link, names: Names, stream: Mapping[str, Any]) -> None:
        self._link = link
        self.observed = Observed(node, stream)
        self.name, self.time_source = self.observed.name, self.observed.time_source
        self.heard = Heard(node, self.observed.type, names[self.name], self._take)

    def look(self) -> str:
        """Look at the other nodes again, and tell what is wrong."""
        return self.heard.look()

    def stop(self) -> None:
        """Take no more."""
        self.heard.stop()

    def _take(self, message: Any, info: Mapping[str, Any]) -> None:
        event = self.observed.event(message, info)
        if event is not None:
            stamp, data, more = event
            self._link.send(self.name, "topic", stamp, data, **more)


class FilteredTopic:
    """Forwards the messages that the oracle allows, in their order; no callback waits for a decision.

    `intercept: publisher` takes X_mon and gives X, `subscriber` takes X and gives X_mon.
    """

    def __init__(self, node: Node, link: Link, board: Board, names: Names, stream: Mapping[str, Any]) -> None:
        self.observed = Observed(node, stream)
        self.name, self.time_source = self.observed.name, self.observed.time_source
        plain, beside = names[self.name], names[self.name + PROXY]
        source, target = (beside, plain) if stream["intercept"] == "publisher" else (plain, beside)
        self._forwarded = Forwarded(node, self.observed.type, target)
        self._gate = Gate(Passing(link, board, stream), self._forwarded.publish)
        self.heard = Heard(node, self.observed.type, source, self._take)

    def look(self) -> str:
        """Look at the other nodes again, and tell what is wrong."""
        troubles = (self.heard.look(), self._forwarded.look(self.heard.offered))
        return "; ".join(trouble for trouble in troubles if trouble)

    def stop(self) -> None:
        """Take and forward no more."""
        self.heard.stop()
        self._forwarded.stop()

    def _take(self, message: Any, info: Mapping[str, Any]) -> None:
        event = self.observed.event(message, info)
        if event is not None:
            stamp, data, more = event
            self._gate.take(message, stamp, data, **more)
