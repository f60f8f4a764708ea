"""Services and actions that nobody serves, as where a spec misspells them: what is called otherwise is not seen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Iterator

from oracle_adapter.unpublished import Unpublished

from oracle_ros2.endpoints import full_name
from oracle_ros2.graph import count_services, hidden

if TYPE_CHECKING:
    from rclpy.node import Node

_STATUS = hidden("", "status")


class UnservedService:
    """Whether nobody has served a service since this began."""

    def __init__(self, node: Node, service: str, kind: str) -> None:
        """`kind`: its type, as `std_srvs/srv/Trigger`."""
        self._node, self._type = node, kind
        self._name = node.resolve_service_name(service)
        self._silence = Unpublished(self._name, does="serves")

    def look(self) -> str:
        """That nobody has, as of now; empty where somebody has, or it is too early."""
        self._silence.look(lambda: count_services(self._node, self._name) > 0, self._others, self._is_served)
        return self._silence.text

    def _others(self) -> Iterator[str]:
        """The services of this type that others have, or call."""
        node = self._node
        # not by the node's name, which another one may have
        own = {node.resolve_service_name(service.srv_name) for service in node.services}
        for name, types in node.get_service_names_and_types():
            if self._type in types and name not in own and name != self._name:
                yield name

    def _is_served(self, service: str) -> bool:
        return count_services(self._node, service) > 0


class UnservedAction:
    """Whether nobody has served an action since this began: who does publishes its status."""

    def __init__(self, node: Node, action: str, proxy: str = "") -> None:
        self._node, self._status = node, node.resolve_topic_name(hidden(action, "status"))
        shown = node.resolve_topic_name(hidden(proxy, "status"))[: -len(_STATUS)] if proxy else ""
        self._silence = Unpublished(self._status[: -len(_STATUS)], does="serves", proxy=shown)
        self.is_served = False
        """Whether somebody serves it, as of the last look."""

    def look(self) -> str:
        """That nobody has, as of now; empty where somebody has, or it is too early."""
        self.is_served = self._node.count_publishers(self._status) > 0
        self._silence.look(lambda: self.is_served, self._others)
        return self._silence.text

    def _others(self) -> Iterator[str]:
        """The actions that others serve."""
        mine = self._node.get_fully_qualified_name()
        for topic, _ in self._node.get_topic_names_and_types():
            if topic.endswith(_STATUS):
                servers = self._node.get_publishers_info_by_topic(topic)
                if any(full_name(server) != mine for server in servers):
                    yield topic[: -len(_STATUS)]
