"""Other monitors that give back what this one passes: that would be judged and passed again, for ever.

As where two specs guard one topic, and one of them takes `intercept: publisher`, the other `intercept: subscriber`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Iterable

from oracle_adapter.monitors import circle_text, errors_among, other_origins

from oracle_ros2.endpoints import full_name, is_named

if TYPE_CHECKING:
    from rclpy.node import Node


def topic_circle(node: Node, heard: str, given: str) -> Circle:
    """The circle of a topic that is passed on, by the names of its two sides."""
    heard, given = node.resolve_topic_name(heard), node.resolve_topic_name(given)
    return Circle(node, heard, given, other_origins(heard, given))


def call_circle(node: Node, service: str, proxy: str) -> Circle:
    """The circle of a service that is called through a proxy; seen over DDS alone."""
    return Circle(node, node.resolve_service_name(proxy), node.resolve_service_name(service), calls=True)


class Circle:
    """The monitors that hear what is given here, and give what is heard here."""

    def __init__(self, node: Node, heard: str, given: str, besides: Iterable[str] = (), *, calls: bool = False) -> None:
        """The names as ROS's remaps make them.

        `besides`: where a monitor may have what it gives from as well; of one that listens there it is taken.
        `calls`: what is heard are calls of a proxy, and what is given are calls of its service.
        """
        self._node, self._heard, self._given, self._calls = node, heard, given, calls
        self._besides = sorted(besides)
        self._known: set[str] = set()
        self._sources: frozenset[str] = frozenset()
        self.text = ""
        """Who they are, and what becomes of what they give, as of the last look; empty where there are none."""

    def look(self) -> None:
        """Look for them again; to be called from time to time."""
        speakers = self._ends(self._heard, self._node.get_publishers_info_by_topic)
        names = self._names(speakers) & self._listeners(self._given) if speakers else set()
        if names:
            names &= self._monitors()
            names.difference_update(*map(self._listeners, self._besides))
        gids = {bytes(info.endpoint_gid).hex(): full_name(info) for info in speakers}
        self._sources = frozenset(gid for gid, name in gids.items() if name in names)
        self._known = {source for source in self._known if any(gid.startswith(source) for gid in gids)}
        self.text = self._told(names) if names else ""

    def has(self, source: str) -> bool:
        """Whether a message of a source comes from one of them; where sources are not told, whether there is one."""
        if source not in self._known:  # its publisher may have come since the last look
            self.look()
            self._known.add(source)
        return any(gid.startswith(source) for gid in self._sources)

    def _told(self, names: Iterable[str]) -> str:
        who = [f"another node named {one}" if one == self._own else one for one in sorted(names)]
        if not self._calls:
            return circle_text(who, self._heard, self._given)
        return (
            f"{' and '.join(who)} is a monitor that serves {self._given} and calls {self._heard}: calls are denied, as "
            "they would come round for ever; judge them by one spec, or give one another name by --remap"
        )

    @property
    def _own(self) -> str:
        return str(self._node.get_fully_qualified_name())

    def _ends(self, name: str, ask: Any) -> list[Any]:
        return list(ask(f"rq{name}Request", no_mangle=True) if self._calls else ask(name))

    def _listeners(self, name: str) -> set[str]:
        return self._names(self._ends(name, self._node.get_subscriptions_info_by_topic))

    def _monitors(self) -> set[str]:
        topics = errors_among(name for name, _ in self._node.get_topic_names_and_types())
        return {name for topic in topics for name in self._names(self._node.get_publishers_info_by_topic(topic))}

    @staticmethod
    def _names(infos: Iterable[Any]) -> set[str]:
        return {full_name(info) for info in infos if is_named(info)}
