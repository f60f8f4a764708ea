"""Who calls a proxy, or serves what is behind it, by another type than the adapter has: no call comes through.

The middleware says nothing of it: the other side waits for ever.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Iterator

from oracle_ros2.endpoints import definition_of, full_name

if TYPE_CHECKING:
    from rclpy.node import Node

_ENDINGS = ("_Request_", "_Response_")


class CallTypes:
    """The types of a service and its proxy on the graph, by the topics that DDS has of calls; none without DDS."""

    def __init__(self, node: Node, service: str, proxy: str) -> None:
        """The names as ROS's remaps make them."""
        self._node, self._service, self._proxy = node, service, proxy
        self._own: dict[str, tuple[str, bytes | None]] = {}  # type and definition, by topic

    def troubles(self) -> Iterator[str]:
        """Who calls and serves in vain, as of now."""
        node, service, proxy = self._node, self._service, self._proxy
        readers, writers = node.get_subscriptions_info_by_topic, node.get_publishers_info_by_topic
        callers = self._unlike(f"rq{proxy}Request", readers, writers)
        callers.update(self._unlike(f"rr{proxy}Reply", writers, readers))
        for caller, how in callers.items():
            yield f"{caller} calls {proxy} {how}: it gets no answer"
        servers = self._unlike(f"rq{service}Request", writers, readers)
        servers.update(self._unlike(f"rr{service}Reply", readers, writers))
        for server, how in servers.items():
            yield f"{server} serves {service} {how}: no call reaches it"

    def _unlike(self, topic: str, here: Any, there: Any) -> dict[str, str]:
        """The nodes that have another type at the other end of a topic, and how they have it."""
        others = there(topic, no_mangle=True)
        if others and topic not in self._own:
            mine = self._node.get_fully_qualified_name()
            own = {
                (one.topic_type, definition_of(one)) for one in here(topic, no_mangle=True) if full_name(one) == mine
            }
            if len(own) == 1:  # else another node has this one's name
                self._own[topic] = own.pop()
        if topic not in self._own:
            return {}
        kind, definition = self._own[topic]
        found = {}
        for other in others:
            told = definition_of(other)
            if other.topic_type != kind:
                found[full_name(other)] = f"as {_plain(other.topic_type)}, not as {_plain(kind)}"
            elif None not in (told, definition) and told != definition:
                found[full_name(other)] = f"by another definition of {_plain(kind)} than is installed here"
        return found


def _plain(kind: str) -> str:
    """What ROS calls a type of DDS's, as `std_srvs::srv::dds_::Trigger_Request_`."""
    for ending in _ENDINGS:
        kind = kind.removesuffix(ending)
    return kind.replace("::dds_::", "::").replace("::", "/")
