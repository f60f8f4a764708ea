"""Topics: those that are only observed, and those whose messages pass when the oracle allows it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Callable, Iterator, Mapping

from oracle_adapter import PROXY
from oracle_adapter.fields import not_there
from oracle_adapter.forwarding import ForwardQueue
from oracle_adapter.kept import Beginning
from oracle_adapter.monitors import OWN, refuse_own
from oracle_adapter.passing import Passing
from oracle_adapter.unread import Unread
from rclpy.serialization import deserialize_message

from oracle_ros2.circles import topic_circle
from oracle_ros2.codec import lacking, load_type, reader
from oracle_ros2.endpoints import MatchedSubscription
from oracle_ros2.graph import Monitors, unguarded
from oracle_ros2.hidden import screener
from oracle_ros2.numbering import Numbers, source_of
from oracle_ros2.qos import lifespan
from oracle_ros2.republished import MatchedPublisher
from oracle_ros2.stamps import USUAL_STAMPS, misplaced, simulated, stamp_reader, time_of

if TYPE_CHECKING:
    from oracle_adapter import Stamp, TimeSource
    from oracle_adapter.interfaces import Interface
    from rclpy.node import Node

    from oracle_ros2.shared import Shared


class Observed:
    """A topic as its messages arrive: their stamp, their publisher, what was missed, and the fields that are read."""

    def __init__(
        self, node: Node, stream: Mapping[str, Any], on_new: Callable[[], None] = lambda: None,
        envelope: tuple[Any, str] | None = None, *, stamped_here: bool = False, frame: int | None = None,
    ) -> None:  # fmt: skip
        """`on_new` is called before the first message of each publisher is an event.

        `envelope`: the type of the messages, and its field in which is what the stream's events are about.
        `stamped_here`: as they are queued for the oracle, unless the spec names a field. `frame`: as in `Shared`.
        """
        self._now = time_of(node)
        self._beginning = Beginning(self._now)
        self.name: str = stream["name"]
        self.kind: str = stream["kind"]
        self.type, self._field = envelope or (load_type(stream["type"]), "")
        inner = type(getattr(self.type(), self._field)) if self._field else self.type
        self._stamp = None if stamped_here and not stream["stamp"] else stamp_reader(inner, stream["stamp"])
        self._stamped_here = stamped_here
        # the middleware's time is the wall's: in a simulation the time of arrival comes nearer
        self._timed_here = stamped_here or simulated(node)
        self.latency: int | None = None if stamped_here and not self._stamp else stream["latency"]
        self.time_source: TimeSource = "field" if self._stamp else "arrival" if self._timed_here else "middleware"
        self.misplaced = ""
        """Why its messages are not ordered by the field that the spec names."""
        if stream["stamp"] and self._stamp is None:
            self.misplaced = misplaced(stream["type"], stream["stamp"], self.time_source)
        self.lacking = not_there(stream["type"], lacking(inner, stream.get("reads") or ()))
        """Which fields the spec reads that the type does not have here."""
        self._read = reader(inner, stream["fields"], frame)
        self._blank = " " * ((frame or 0) + 1)
        self._screened = screener(self.type, _paths(stream, self._field), frame)
        self.is_foreign: Callable[[str], bool] = lambda _: False
        """Whether messages of a source are defined otherwise than here: they can't be read."""
        self.lasts: Callable[[], bool] = lambda: False
        """Whether messages come that were published before anybody asked for them."""
        self._numbers = Numbers(on_new)
        self.unread = Unread()
        """Messages that can't be read, and what was missed before them, until an event tells it."""
        self.unreadable: dict[str, str] = {}
        """Why messages of a publisher can't be read, by its source."""
        self.count = 0
        """How many messages have come."""

    def event(self, serialized: bytes, info: Mapping[str, Any]) -> tuple[Stamp, Any, dict[str, Any]] | None:
        """The stamp (ns) or what reads it as the event is queued, the data and the rest of a message's event.

        None where it came before, or can't be read: then it is counted as lost, and in `unreadable`.
        """
        missed = self.missed(info)
        return None if missed < 0 else self.decoded(serialized, info, missed)

    def missed(self, info: Mapping[str, Any]) -> int:
        """Count a message that has come: how many were lost before it; -1 where it came before."""
        self.count += 1
        return self._numbers.missed(source_of(info), info)

    def decoded(
        self, serialized: bytes, info: Mapping[str, Any], missed: int
    ) -> tuple[Stamp, Any, dict[str, Any]] | None:
        """The event of a message that `missed` has counted; None where it can't be read."""
        source = source_of(info)
        if self.is_foreign(source):
            self.unread.add(missed + 1)
            return None
        try:
            screened, is_too_long = self._screened(serialized)
            message = deserialize_message(screened, self.type)
            if self._field:
                message = getattr(message, self._field)
        except Exception as error:  # noqa: BLE001 - whatever another node sends
            self.unread.add(missed + 1)
            self.unreadable[source] = str(error) or type(error).__name__
            return None
        missed += self.unread.take()
        stamp = (self._stamp and self._stamp(message)) or self._time_of(info)
        if isinstance(stamp, int) and self.lasts() and self._beginning.is_after(stamp):
            stamp = self._now()
        data = self._blank if is_too_long else self._read(message)
        return stamp, data, {"source": source, "lost": missed}

    def _time_of(self, info: Mapping[str, Any]) -> Stamp:
        if self._stamped_here:
            return self._now
        return (self._now() if self._timed_here else info["source_timestamp"]) or None


def _paths(stream: Mapping[str, Any], envelope: str) -> list[str] | None:
    """What is read of a stream's messages, whose fields may be in one of an envelope; None for all."""
    if stream["fields"] is None:
        return None
    stamps = (stream["stamp"],) if stream["stamp"] else USUAL_STAMPS
    return [f"{envelope}.{path}" if envelope else path for path in (*stream["fields"], *stamps)]


class LoggedTopic:
    """Reports every message of a topic, but for those of monitors on `OWN`."""

    bypass = ""

    def __init__(self, shared: Shared, topic: Interface) -> None:
        self._link = shared.link
        self.observed = Observed(shared.node, topic.first, frame=shared.frame)
        self.streams = [self.observed]
        resolve = shared.node.resolve_topic_name
        has_monitors = resolve(shared.names[topic.name]) in map(resolve, OWN)
        self.subscription = MatchedSubscription(shared.node, self.observed.type, shared.names[topic.name], self._take)
        self._monitors = Monitors(shared.node, self.subscription) if has_monitors else None
        self.observed.is_foreign, self.observed.lasts = self.subscription.is_foreign, self.subscription.lasts

    @property
    def received(self) -> int:
        """How many messages have come."""
        return self.observed.count

    @property
    def doubt(self) -> str:
        """That nobody publishes it, as of the last look, or who is left out that may be no monitor.

        A publisher that came and went between two looks counts.
        """
        unpublished = "" if self.observed.count else self.subscription.unpublished.text
        return unpublished or (self._monitors.doubt if self._monitors is not None else "")

    def catch_up(self) -> None:
        """Take every message that has come by now."""
        self.subscription.take_all()

    def look(self) -> str:
        """Look at the other nodes again, and return what is wrong."""
        untold = self._link.lost(self.observed.unread.overdue())
        if self._monitors is not None:
            self._monitors.look()
        troubles = (
            self.subscription.look(),
            self.observed.misplaced,
            self.observed.lacking,
            *unreadable(self, untold),
        )
        return "; ".join(trouble for trouble in troubles if trouble)

    def stop(self) -> None:
        """Take no more."""
        self.subscription.stop()

    def _take(self, message: bytes, info: Mapping[str, Any]) -> None:
        if self._monitors is not None and self._monitors.have(source_of(info)):
            return
        event = self.observed.event(message, info)
        if event is not None:
            stamp, data, more = event
            self._link.send(self.observed.name, self.observed.kind, stamp, data, **more)


class ExpiredError(Exception):
    """A message has waited for its decision for longer than it is of use."""

    def __init__(self) -> None:
        super().__init__("its publisher's lifespan was over before it was decided on")


class FilteredTopic:
    """Forwards the messages that the oracle allows, in their order; no callback waits for a decision.

    `intercept: publisher` takes X_mon and gives X, `subscriber` takes X and gives X_mon.
    """

    def __init__(self, shared: Shared, topic: Interface) -> None:
        node, stream = shared.node, topic.first
        self.observed = Observed(node, stream, self._match, frame=shared.frame)
        self.streams = [self.observed]
        plain, beside = shared.names[topic.name], shared.names[topic.name + PROXY]
        source, target = (beside, plain) if stream["intercept"] == "publisher" else (plain, beside)
        refuse_own(topic.name, node.resolve_topic_name(source), map(node.resolve_topic_name, OWN))
        self._link, self._node = shared.link, node
        self._heard, self._given, self._unguarded = source, target, ""
        self._circle = topic_circle(node, source, target)
        self._publisher = MatchedPublisher(node, self.observed.type, target)
        passing = Passing(shared.link, shared.board, stream, shared.clocks)
        self._queue = ForwardQueue(passing, self._give, size=lambda said: len(said[0]))
        self._lifespan: float | None = None
        self.subscription = MatchedSubscription(node, self.observed.type, source, self._take)
        self.observed.is_foreign, self.observed.lasts = self.subscription.is_foreign, self.subscription.lasts

    @property
    def received(self) -> int:
        """How many messages have come."""
        return self.observed.count

    @property
    def doubt(self) -> str:
        """That nobody publishes it, or hears what passes, as of the last look.

        A publisher that came and went between two looks counts.
        """
        unpublished = "" if self.observed.count else self.subscription.unpublished.text
        return "; ".join(filter(None, (self._unguarded, unpublished)))

    @property
    def bypass(self) -> str:
        """Who publishes past the monitor what it forwards, or gives it back."""
        return "; ".join(filter(None, (self._publisher.bypass, self._circle.text)))

    def catch_up(self) -> None:
        """Take every message that has come by now."""
        self.subscription.take_all()

    def look(self) -> str:
        """Look at the other nodes again, and return what is wrong."""
        untold = self._link.lost(self.observed.unread.overdue())
        heard = self.subscription
        self._circle.look()
        found = heard.look(), self._publisher.look(heard.offered, heard.sources), self._circle.text
        self._lifespan = lifespan(heard.offered)
        self._unguarded = unguarded(self._node, self._heard, self._given)
        troubles = (*found, self.observed.misplaced, self.observed.lacking, *unreadable(self, untold))
        return "; ".join(trouble for trouble in troubles if trouble)

    def stop(self) -> None:
        """Take and forward no more."""
        self.subscription.stop()
        self._publisher.stop()

    def _match(self) -> None:
        """Do not wait for the next look: a new publisher may publish only once."""
        self.subscription.look_around()
        self._lifespan = lifespan(self.subscription.offered)
        self._publisher.match(self.subscription.offered, self.subscription.sources)

    def _take(self, message: bytes, info: Mapping[str, Any]) -> None:
        if self._circle.has(source_of(info)):
            return
        self._publisher.is_told = bool(source_of(info))
        event = self.observed.event(message, info)
        if event is not None:
            stamp, data, more = event
            end = None if self._lifespan is None else time.monotonic() + self._lifespan
            self._queue.take((message, more["source"], end), stamp, data, **more)

    def _give(self, said: tuple[bytes, str, float | None]) -> bool:
        """Pass a message on, unless it is of no use any more: the middleware would begin to count anew."""
        message, source, end = said
        if end is not None and time.monotonic() > end:
            raise ExpiredError
        return self._publisher.publish(message, source)


def unreadable(topic: LoggedTopic | FilteredTopic, untold: bool) -> Iterator[str]:
    """Whose messages can't be read, and why; of who has ended while that may be `untold` by an event, as the last."""
    for source, why in list(topic.observed.unreadable.items()):
        there = bool(topic.subscription.sources) and not source  # it is not told who
        node = "one of its publishers" if there else topic.subscription.publisher(source)
        if node is None and (untold or topic.observed.unread):
            yield f"a publisher that has ended has published what can't be read: {why}"
        elif node is None:
            del topic.observed.unreadable[source]
        else:
            yield f"{node} publishes what can't be read: {why}"
