"""Subscriptions that match the publishers of the other nodes, and report which don't match.

One that matches better is used beside the old one until it is discovered: no message must be lost meanwhile.
"""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING, Any, Callable, Iterator, Mapping, Sequence

from oracle_adapter.unpublished import Unpublished
from rclpy.qos import DurabilityPolicy

from oracle_ros2.numbering import is_numbered
from oracle_ros2.qos import DEPTH, NO_SUBSCRIPTION_EVENTS, same, to_request
from oracle_ros2.unmatched import Unmatched, publishers_of

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.qos import QoSProfile

UNKNOWN = "a node of unknown name"
_UNNAMED = {
    "_NODE_NAME_UNKNOWN_": UNKNOWN,  # for a moment, where its endpoint is discovered before it is
    "_CREATED_BY_BARE_DDS_APP_": "a program on DDS that is no ROS node",
}

Take = Callable[[bytes, Mapping[str, Any]], None]

MATCHING = 0.4
"""Seconds in which a new publisher or subscription is discovered, before the old one is destroyed.

The next look can come at once, where one was late.
"""


class MatchedSubscription:
    """Subscribes to every publisher of a topic, whatever quality of service it offers; messages come serialized.

    `look` is to be called from time to time, where callbacks run. A message may come twice while one subscription is in
    another's place: it has its number twice, and is taken once where it has none.
    """

    def __init__(self, node: Node, message_type: Any, topic: str, take: Take) -> None:
        """Subscribe at once."""
        self._node, self._type, self._topic, self._take = node, message_type, topic, take
        self.offered: list[QoSProfile] = []
        """What the publishers of the type offer, as of the last look; of another type nothing comes."""
        self._definition: bytes | None = None
        self._foreign: list[str] = []  # the publishers whose type is defined otherwise
        self._looked_for: set[str] = set()
        self._subscriptions: list[Any] = []
        self._came: deque[int] = deque(maxlen=DEPTH)  # when the last ones without numbers were published (ns)
        name = node.resolve_topic_name(topic)
        self.unpublished = Unpublished(name)
        self._unheard = Unmatched(f"publishes {name}, and nothing of it is heard")
        self._publishers = self._look_around()
        self._subscribe(to_request(self.offered))

    def look(self) -> str:
        """Look at the publishers again, and return what is wrong with them."""
        while len(self._subscriptions) > 1 and time.monotonic() - self._made >= MATCHING:
            self._drain(self._subscriptions[0])
            self._node.destroy_subscription(self._subscriptions.pop(0))
        self._publishers = self._look_around()
        self._looked_for = {source for source in self._looked_for if any(s.startswith(source) for s in self.sources)}
        self.unpublished.look(lambda: bool(self._publishers), self._others, self._is_others)
        wanted = to_request(self.offered)
        if self.offered and not same(wanted, self._profile):
            name = self._node.resolve_topic_name(self._topic)
            text = f"matching the publishers of {name}: {wanted.reliability.name.lower()}"
            self._node.get_logger().info(f"{text}, {wanted.durability.name.lower()}")
            self._subscribe(wanted)
        return "; ".join(self._troubles())

    def take_all(self) -> None:
        """Take every message that has come by now; to be called where callbacks run."""
        for subscription in self._subscriptions:
            self._drain(subscription)

    def look_around(self) -> None:
        """Read what the publishers offer now, where that can't wait for `look`."""
        self._publishers = self._look_around()

    def publisher(self, source: str) -> str | None:
        """The node that has the publisher of a `source`; None where it has ended, or is not told."""
        if not source:
            return None
        nodes = (full_name(info) for info in self._publishers if bytes(info.endpoint_gid).hex().startswith(source))
        return next(nodes, None)

    def is_foreign(self, source: str) -> bool:
        """Whether messages of a source are defined otherwise than here; where sources are not told, whether any are.

        They may come all the same, and would be read as what they are not.
        """
        is_new = source not in self._looked_for or (not source and self._connected() != self._connected_before)
        if is_new:  # its publisher may have come since the last look
            self._looked_for.add(source)
            self.look_around()
        return any(publisher.startswith(source) for publisher in self._foreign)

    def lasts(self) -> bool:
        """Whether what publishers have kept for late subscribers comes."""
        return bool(self._profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)

    @property
    def nodes(self) -> list[str]:
        """The nodes that have the publishers, as of the last look."""
        return [full_name(info) for info in self._publishers]

    @property
    def sources(self) -> list[str]:
        """The publishers, as of the last look."""
        return [bytes(info.endpoint_gid).hex() for info in self._publishers]

    def stop(self) -> None:
        """Unsubscribe."""
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop())

    def _drain(self, subscription: Any) -> None:
        handle = subscription.handle
        with handle:
            for _ in range(DEPTH):
                taken = handle.take_message(self._type, True)
                if taken is None:
                    break
                subscription.callback(*taken)

    def _connected(self) -> int | None:
        """How many publishers it is connected to, which costs less than to look around; None where not told."""
        return publishers_of(self._subscriptions[-1]) if self._subscriptions else None

    def _look_around(self) -> Sequence[Any]:
        self._connected_before = self._connected()
        found = self._node.get_publishers_info_by_topic(self._topic)
        self.offered = [info.qos_profile for info in found if info.topic_type == type_name(self._type)]
        self._foreign = [bytes(info.endpoint_gid).hex() for info in found if self._is_other(info)]
        return found

    def _is_other(self, publisher: Any) -> bool:
        """Whether a publisher has another definition of the type; of one with another type nothing comes."""
        if publisher.topic_type != type_name(self._type):
            return False
        told = definition_of(publisher)
        if told is not None and self._definition is None and self._subscriptions:
            self._definition = self._own()
        return None not in (told, self._definition) and told != self._definition

    def _own(self) -> bytes | None:
        """The definition of the type here; None where it is not sure.

        As where another node has this one's name: one that was killed stays on the graph for a while, and may have had
        an older definition.
        """
        there = self._node.get_subscriptions_info_by_topic(self._topic)
        mine = self._node.get_fully_qualified_name(), type_name(self._type)
        own = {definition_of(info) for info in there if (full_name(info), info.topic_type) == mine}
        return own.pop() if len(own) == 1 else None

    def _others(self) -> Iterator[str]:
        """The other topics of this type."""
        own, wanted = self._node.resolve_topic_name(self._topic), type_name(self._type)
        return (name for name, types in self._node.get_topic_names_and_types() if wanted in types and name != own)

    def _is_others(self, topic: str) -> bool:
        """Whether another node publishes a topic."""
        own = self._node.get_fully_qualified_name()
        return any(full_name(info) != own for info in self._node.get_publishers_info_by_topic(topic))

    def _troubles(self) -> Iterator[str]:
        wanted = type_name(self._type)
        fitting = []
        for info in self._publishers:
            if info.topic_type != wanted:
                yield f"{full_name(info)} publishes it as {info.topic_type}, not as {wanted}"
            elif self._is_other(info):
                yield f"{full_name(info)} publishes it by another definition of {wanted} than is installed here"
            else:
                fitting.append(full_name(info))
        unheard = self._unheard.look(fitting, self._connected())
        if unheard:
            yield unheard
        if len({profile.durability for profile in self.offered}) > 1:
            yield "its publishers differ in durability: what some have kept for late subscribers is not received"

    def _came_before(self, published: int) -> bool:
        """Whether another subscription has got a message: by its time, which two publishers share once in a while."""
        found = bool(published) and len(self._subscriptions) > 1 and published in self._came
        self._came.append(published)
        return found

    def _subscribe(self, profile: QoSProfile) -> None:
        take, older = self._take, self._subscriptions.copy()

        def callback(message: Any, info: Any) -> None:  # rclpy hands over `info` by the number of parameters
            if older:  # what only they got is older, and would be taken for lost
                older[:] = [one for one in older if one in self._subscriptions]
                for one in older:
                    self._drain(one)
            if is_numbered(info) or not self._came_before(info["source_timestamp"]):
                take(message, info)

        self._profile, self._made = profile, time.monotonic()
        subscription = self._node.create_subscription(
            self._type, self._topic, callback, profile, event_callbacks=NO_SUBSCRIPTION_EVENTS, raw=True
        )
        self._subscriptions.append(subscription)


def type_name(message_type: Any) -> str:
    """What the graph calls a message type."""
    package, kind = message_type.__module__.split(".")[:2]
    return f"{package}/{kind}/{message_type.__name__}"


def definition_of(info: Any) -> bytes | None:
    """What stands for the definition of an endpoint's type; None where that is not told, as before Iron."""
    told = getattr(info, "topic_type_hash", None)
    return bytes(told.value) if told is not None and told.version > 0 else None


def full_name(info: Any) -> str:
    """The name of an endpoint's node, or what stands for it where it has none."""
    return _UNNAMED.get(info.node_name) or f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def is_named(info: Any) -> bool:
    """Whether an endpoint is that of a node whose name is known."""
    return info.node_name not in _UNNAMED
