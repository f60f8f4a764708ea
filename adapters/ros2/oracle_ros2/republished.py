"""Publishers of what is passed on, that match the messages' own publishers, and report who is past them or lacks them.

Ones that match better are used in place of the old ones once they are discovered: no message must be lost meanwhile.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Iterator, Sequence

from oracle_ros2.endpoints import MATCHING, definition_of, full_name
from oracle_ros2.qos import NO_EVENTS, ROOM, depth_for, lasts, leases, misfit, same, to_offer
from oracle_ros2.unmatched import Unmatched

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.qos import QoSProfile


GROWING = 0.6
"""Seconds in which those that are to take over may be made anew for more publishers that are not told apart."""


class MatchedPublisher:
    """Publishes what is passed on, with the quality of service of the messages' own publishers.

    Each of these that keeps its last message for those who come later has a publisher here, which keeps that. Where
    there are to be more of them, or they are to offer something else, what passes waits until they are discovered: else
    what is published once would be lost to some. So it is where the originals promise a lease, to those who ask for it.
    """

    def __init__(self, node: Node, message_type: Any, topic: str, offered: Sequence[QoSProfile] = ()) -> None:
        """Offer what `offered` would have it until `look` is given what the originals offer."""
        self._node, self._type, self._topic = node, message_type, topic
        self._name = name = node.resolve_topic_name(topic)  # as others know it
        self._ungiven = Unmatched(f"subscribes to {name}, and gets nothing of it")
        self.bypass = ""
        """Who else publishes the topic, as of the last look; empty where nobody does."""
        self._namesakes: list[str] = []  # as of the last look at which the publishers were not being changed
        self._giving = threading.Lock()
        self._publishers = self._next = [self._make(to_offer(offered))]
        self._users: dict[str, Any] = {}  # the publisher of each source
        self.is_told = True
        """Whether the middleware tells the sources of messages."""
        self._kept: dict[Any, deque[Any]] = {}  # what publishers keep that last; who published last comes last
        self._left: dict[str, list[Any]] = {}  # what sources had kept that are not there; who went last comes last
        self._retired: list[Any] = []
        self._largest = 0  # of the messages so far (bytes)
        self._changed = 0.0  # when the next ones were made, or took over (s)
        self._held: list[tuple[Any, str]] | None = None  # what waits for the next ones
        self._held_since = 0.0

    def publish(self, message: Any, source: str = "") -> bool:
        """Pass a message of a source on, from any thread; False after `stop`."""
        with self._giving:
            if isinstance(message, bytes):
                self._largest = max(self._largest, len(message))
            if self._held is not None and not self._stays(source):
                self._held.append((message, source))
            elif self._publishers:
                self._give(message, source)
            return bool(self._publishers)

    def stop(self) -> None:
        """Pass nothing on any more."""
        with self._giving:
            made = {*self._publishers, *self._next, *self._retired}
            self._take_over()
            for publisher in made:
                self._node.destroy_publisher(publisher)
            self._publishers = self._next = self._retired = []

    def look(self, originals: Sequence[QoSProfile], sources: Sequence[str] | None = None) -> str:
        """Offer what the originals do, and return what is wrong on the topic.

        `sources`: as for `match`; what one of them has kept goes with it, unless they are None.
        """
        if self._next is not self._publishers and not self.is_told:
            self.match(originals, sources or ())  # more may have come than those that the next ones were made for
        if time.monotonic() - self._changed >= MATCHING:
            while self._retired:
                self._node.destroy_publisher(self._retired.pop())
            if self._next is not self._publishers:
                with self._giving:
                    self._retired = [one for one in self._publishers if one not in self._next]
                    self._changed = time.monotonic()
                    self._take_over()
            self.match(originals, sources or ())
            if sources is not None:
                if not originals:
                    self._withdraw()
                self._forget(sources)
        return "; ".join(self._find_troubles())

    def match(self, originals: Sequence[QoSProfile], sources: Sequence[str] = ()) -> None:
        """Begin to offer what the originals do, unless something else is begun.

        `sources`: the publishers that are told apart; without them all are taken for one.
        """
        if not originals:
            return
        wanted, offered = to_offer(originals, depth_for(self._largest)), self._next[0].qos_profile
        changing = self._next is not self._publishers
        count = max(1, len(sources)) if lasts(wanted) else 1
        with self._giving:
            if lasts(wanted) and not self.is_told:
                wanted.depth, count = max(count, offered.depth if lasts(offered) else 1), 1
            self._part_with(sources)
            if changing and not same(wanted, offered) and not self._may_begin_anew():
                return
            if not same(wanted, offered):
                last = lasts(wanted) and (lasts(offered) or all(map(lasts, originals)))
                if last or leases(wanted) > leases(offered):
                    self._hold()
                for begun in [one for one in self._next if one not in self._publishers]:
                    self._node.destroy_publisher(begun)
                self._replace([self._make(wanted) for _ in range(count)])
            elif count > len(self._next):
                self._hold()
                more = [self._make(wanted) for _ in range(count - len(self._next))]
                if not changing or time.monotonic() - self._held_since < MATCHING:
                    self._changed = time.monotonic()
                self._next = [*self._next, *more]
            elif not changing:
                self._do_without(len(self._publishers) - count)

    def _withdraw(self) -> None:
        """Promise nobody's lease: who watches it is to see that the originals have gone."""
        with self._giving:
            if self._next is not self._publishers or not leases(self._publishers[0].qos_profile):
                return
            self._part_with(())
            for publisher in self._publishers:
                self._node.destroy_publisher(publisher)
            self._kept.clear()
            self._publishers = self._next = [self._make(to_offer((), depth_for(self._largest)))]

    def _part_with(self, sources: Sequence[str]) -> None:
        """Set aside what those have kept that are not there any more: they may have been out of reach only."""
        for one in [one for one in self._users if not _are_among(one, sources)]:
            kept = self._kept.get(self._users.pop(one))
            if kept:
                self._left[one] = list(kept)
        while self._left and sum(_size(message) for left in self._left.values() for message in left) > ROOM:
            del self._left[next(iter(self._left))]

    def _forget(self, sources: Sequence[str]) -> None:
        """Keep nothing that only those have kept that are not there any more, and again what those have that are back.

        The middleware gives that again, and it is taken for what has come before.
        """
        with self._giving:
            if self._next is not self._publishers or (sources and not self.is_told):
                return
            self._part_with(sources)
            back = {one: self._left.pop(one) for one in [*self._left] if _are_among(one, sources)}
            used = list(self._users.values())
            ended = [one for one in self._kept if one not in used]
            if ended:
                self._hold()
                self._changed = time.monotonic()
                self._next = [self._make(one.qos_profile) if one in ended else one for one in self._publishers]
        for source, messages in back.items():
            for message in messages:
                self.publish(message, source)

    def _hold(self) -> None:
        """Hold what comes from now on."""
        if self._held is None:
            self._held, self._held_since = [], time.monotonic()

    def _may_begin_anew(self) -> bool:
        """Whether others may be made in place of those that are to take over.

        Where the originals are not told apart one of these keeps a message of each: what is held is more than it keeps
        where more of them come.
        """
        grows = self._held is not None and time.monotonic() - self._held_since < GROWING
        return not self.is_told and (len(self._next) > 1 or grows)

    def _stays(self, source: str) -> bool:
        """Whether the publisher of a source goes on, and has not to be waited for."""
        user = self._users.get(source)
        return user in self._publishers and user in self._next

    def _replace(self, made: list[Any]) -> None:
        """Have publishers take over, and keep what the old ones kept."""
        self._next, self._changed = made, time.monotonic()
        places: dict[Any, Any] = {}
        if lasts(made[0].qos_profile):
            used = list(self._users.values())
            old = sorted(self._kept, key=lambda one: one not in used)
            places = dict(zip(old, made, strict=False))
        depth = made[0].qos_profile.depth
        self._users = {source: places[one] for source, one in self._users.items() if one in places}
        self._kept = {places[old]: deque(kept, depth) for old, kept in self._kept.items() if old in places}
        for publisher, messages in self._kept.items():
            for message in messages:
                publisher.publish(message)

    def _do_without(self, count: int) -> None:
        """Destroy so many publishers, whose sources have ended."""
        used = list(self._users.values())
        for publisher in [one for one in self._publishers if one not in used][:count]:
            self._kept.pop(publisher, None)
            self._node.destroy_publisher(publisher)
            self._publishers.remove(publisher)

    def _take_over(self) -> None:
        """Have the next ones publish, at first what was held."""
        self._publishers = self._next
        self._users = {source: one for source, one in self._users.items() if one in self._publishers}
        self._kept = {one: messages for one, messages in self._kept.items() if one in self._publishers}
        held, self._held = self._held or [], None
        for message, source in held:
            try:
                self._give(message, source)
            except Exception as error:  # noqa: BLE001 - others wait behind it
                self._node.get_logger().error(f"a message of {self._name} could not be passed on: {error!r}")

    def _give(self, message: Any, source: str) -> None:
        publisher = self._publisher_of(source)
        publisher.publish(message)
        profile = publisher.qos_profile
        if lasts(profile):
            kept = self._kept.pop(publisher, None) or deque(maxlen=profile.depth)
            self._kept[publisher] = kept
            kept.append(message)

    def _publisher_of(self, source: str) -> Any:
        if not source:
            return self._publishers[0]
        if source not in self._users:
            used = list(self._users.values())
            unused = (one for one in self._publishers if one not in used)
            self._users[source] = next(unused, self._publishers[0])
        return self._users[source]

    def _make(self, profile: QoSProfile) -> Any:
        return self._node.create_publisher(self._type, self._topic, profile, event_callbacks=NO_EVENTS)

    def _find_troubles(self) -> Iterator[str]:
        own, others = [], []
        for info in self._node.get_publishers_info_by_topic(self._topic):
            (own if self._has_own_name(info) else others).append(info)
        if not self._retired and self._next is self._publishers:  # else there are more of one's own
            self._namesakes = [f"another node named {full_name(info)}" for info in own[len(self._publishers) :]]
        past = [*map(full_name, others), *self._namesakes]
        self.bypass = "; ".join(f"{other} publishes {self._name} past the monitor" for other in past)
        if self.bypass:
            yield self.bypass
        fitting = []
        for info in self._node.get_subscriptions_info_by_topic(self._topic):
            reasons = [misfit(one.qos_profile, info.qos_profile) or _unlike(one, info) for one in own]
            if reasons and all(reasons):
                yield f"{full_name(info)} can't receive {self._name}: {reasons[0]}"
            else:
                fitting.append(full_name(info))
        ungiven = self._ungiven.look(fitting, self._publishers[0].get_subscription_count())
        if ungiven:
            yield ungiven

    def _has_own_name(self, info: Any) -> bool:
        mine = (self._node.get_name(), self._node.get_namespace())
        return (info.node_name, info.node_namespace) == mine


def _are_among(source: str, sources: Sequence[str]) -> bool:
    """Whether a publisher is there, by its number in messages, with which that on the graph begins."""
    return any(one.startswith(source) for one in sources)


def _size(message: Any) -> int:
    return len(message) if isinstance(message, bytes) else 0


def _unlike(publisher: Any, subscription: Any) -> str:
    """Why a subscription does not read what a publisher gives; empty where both have one definition of one type."""
    if publisher.topic_type != subscription.topic_type:
        return f"it subscribes to it as {subscription.topic_type}, not as {publisher.topic_type}"
    definitions = definition_of(publisher), definition_of(subscription)
    if None in definitions or definitions[0] == definitions[1]:
        return ""
    return f"it has another definition of {subscription.topic_type} than is installed here"
