"""Subscriptions that hear every publisher of their topic, whatever quality of service it offers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, Mapping

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

if TYPE_CHECKING:
    from rclpy.node import Node

DEPTH = 1000

Take = Callable[[Any, Mapping[str, Any]], None]


class Matched:
    """A subscription that is made anew where a publisher appears that it could not hear."""

    def __init__(self, node: Node, message_type: Any, topic: str, take: Take) -> None:
        self._node, self._type, self._topic, self._take = node, message_type, topic, take
        self._profile = self._wanted()
        self._subscription = self._subscribe()

    def rematch(self) -> None:
        """Look at the publishers again."""
        wanted = self._wanted()
        if (wanted.reliability, wanted.durability) == (self._profile.reliability, self._profile.durability):
            return
        self._node.get_logger().info(f"matching the publishers of {self._topic}: {wanted.reliability.name.lower()}")
        self._profile = wanted
        self._node.destroy_subscription(self._subscription)
        self._subscription = self._subscribe()

    def take_all(self) -> None:
        """Take every message that has come by now; to be called where callbacks run."""
        handle = self._subscription.handle
        with handle:
            for _ in range(DEPTH):
                taken = handle.take_message(self._type, False)
                if taken is None:
                    break
                self._take(*taken)

    def _wanted(self) -> QoSProfile:
        """The strictest profile that every publisher offers; reliable and volatile where there is none yet."""
        offered = [info.qos_profile for info in self._node.get_publishers_info_by_topic(self._topic)]
        reliable = all(profile.reliability != ReliabilityPolicy.BEST_EFFORT for profile in offered)
        lasting = offered and all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in offered)
        return QoSProfile(
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if lasting else DurabilityPolicy.VOLATILE,
        )

    def _subscribe(self) -> Any:
        take = self._take

        def callback(message: Any, info: Any) -> None:  # rclpy hands over `info` by the number of parameters
            take(message, info)

        return self._node.create_subscription(self._type, self._topic, callback, self._profile)
