"""Who publishes, subscribes, serves and calls what: the live graph, as `oracle-server check --ros-graph` reads it."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Any, Callable

from oracle_adapter.monitors import doubt_text, doubtful, errors_among, namesakes_text
from rclpy.executors import SingleThreadedExecutor

from oracle_ros2.endpoints import UNKNOWN, full_name, is_named

if TYPE_CHECKING:
    from rclpy.node import Node

    from oracle_ros2.endpoints import MatchedSubscription

SETTLED = 4.0  # seconds without a change after which discovery is taken to be complete
DISCOVERY_LIMIT = 20.0
PARTICIPANT = 24  # digits of a publisher's number that are those of its participant
NAMING = 2.0  # seconds in which a new publisher's node is looked for at each of its messages
UNTOLD = (
    "who publishes it is not told before ROS 2 Kilted, nor over Cyclone DDS: what monitors say here is taken for the "
    "robot's"
)
NOISE = ("/rosout", "/parameter_events")
PARAMETERS = ("describe_parameters", "get_parameter_types", "get_parameters", "get_type_description",
              "list_parameters", "set_parameters", "set_parameters_atomically")  # fmt: skip

Named = Callable[[str, str], "list[tuple[str, list[str]]]"]


def dump_graph(node: Node, is_ended: Callable[[], bool]) -> dict[str, Any] | None:
    """The graph without `node` itself, once discovery has settled; types by the names of topics and services.

    None where it `is_ended` before.
    """
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    graph, since, end = _look(node), time.monotonic(), time.monotonic() + DISCOVERY_LIMIT
    while time.monotonic() < min(since + SETTLED, end) and not is_ended():
        executor.spin_once(timeout_sec=0.05)
        now = _look(node)
        if now != graph:
            graph, since = now, time.monotonic()
    executor.remove_node(node)
    executor.shutdown()
    return None if is_ended() else graph


def hidden(action: str, interface: str) -> str:
    """The name of one of an action's interfaces."""
    return f"{action}/_action/{interface}"


def servers(node: Node, service: str) -> frozenset[bytes]:
    """Who serves a service by its whole name: the readers of its requests, as DDS has them; empty without DDS."""
    found = node.get_subscriptions_info_by_topic(f"rq{service}Request", no_mangle=True)
    return frozenset(bytes(info.endpoint_gid) for info in found)


def past_proxy(node: Node, *proxied: tuple[str, str]) -> str:
    """Who can call services without their proxies, and who serves a proxy's name besides `node`; else an empty text.

    `proxied`: services with their proxies; of those of one action a node is told once. That a node has a client is on
    the graph, and not whether it calls.
    """
    troubles: dict[tuple[str, str], str] = {}
    for service, proxy in proxied:
        _find_past(node, node.resolve_service_name(service), node.resolve_service_name(proxy), troubles)
    return "; ".join(troubles.values())


def _find_past(node: Node, service: str, proxy: str, troubles: dict[tuple[str, str], str]) -> None:
    """Tell of one service, by names that ROS has resolved: counts take no remaps."""
    callers = _besides(node, _count_clients(node, service), node.get_client_names_and_types_by_node, service)
    servers = _besides(node, count_services(node, proxy), node.get_service_names_and_types_by_node, proxy)
    for other in callers:
        troubles.setdefault(("calls", other), f"{other} can call {service} past the monitor")
    for other in servers:
        troubles.setdefault(("serves", other), f"{other} serves {proxy} beside the monitor")


def unguarded(node: Node, heard: str, given: str) -> str:
    """Who hears what `node` hears, where nobody hears what passes: as where a remap is missing; else empty."""
    ask = node.get_subscriptions_info_by_topic
    if ask(given):
        return ""
    others = sorted({full_name(info) for info in ask(heard)} - {node.get_fully_qualified_name()})
    if not others:
        return ""
    heard, given = node.resolve_topic_name(heard), node.resolve_topic_name(given)
    return f"nobody hears {given}, and past the monitor hears {heard}: {', '.join(others)}"


def namesakes(node: Node, topic: str) -> str:
    """Who else publishes a topic of this monitor's own, as another one of its name does; empty where nobody does."""
    mine = node.get_fully_qualified_name()
    found = Counter(full_name(info) for info in node.get_publishers_info_by_topic(topic))
    found[mine] -= 1
    others = sorted(f"another node named {mine}" if name == mine else name for name in +found)
    return namesakes_text(others, topic)


class Monitors:
    """Which nodes are monitors, this one among them: what they say of violations is no event of the robot's.

    This one is, whatever ROS's remaps make of its topics. The middleware tells of a topic's publisher before it tells
    of its node: until then, one monitor's are known by their participant, on DDS the first 12 bytes of their numbers.
    """

    def __init__(self, node: Node, heard: MatchedSubscription) -> None:
        """`heard`: where they may say something."""
        self._node, self._heard = node, heard
        self._names: frozenset[str] = frozenset()
        self._participants: frozenset[str] = frozenset()
        self._nameless: frozenset[str] = frozenset()  # the participants of monitors whose nodes are not known yet
        self._untold = False
        self.doubt = ""
        """Who may be none, as of the last look, or that they can't be told from others."""
        self._since: dict[str, float] = {}  # when sources were first heard (s)

    def look(self) -> None:
        """Look for them again; to be called from time to time."""
        topics = errors_among(name for name, _ in self._node.get_topic_names_and_types())
        by_topic = {topic: self._node.get_publishers_info_by_topic(topic) for topic in topics}
        found = [info for infos in by_topic.values() for info in infos]
        self._names = frozenset(full_name(info) for info in found if is_named(info))
        named = {topic: [full_name(info) for info in infos if is_named(info)] for topic, infos in by_topic.items()}
        others = set(self._heard.nodes) - {self._node.get_fully_qualified_name()}
        self.doubt = UNTOLD if self._untold else doubt_text(doubtful(named), others)
        self._participants = frozenset(map(_participant, found))
        self._nameless = frozenset(_participant(info) for info in found if full_name(info) == UNKNOWN)
        self._since = {one: at for one, at in self._since.items() if self._heard.publisher(one) is not None}

    def have(self, source: str) -> bool:
        """Whether a source of what is heard is theirs; never where sources are not told."""
        self._untold = not source
        if self._untold:
            return False
        now = time.monotonic()
        since = self._since.setdefault(source, now)
        if since == now or (now - since < NAMING and self._heard.publisher(source) == UNKNOWN):
            self._heard.look_around()  # it may have come since the last look
            self.look()
        name, participant = self._heard.publisher(source), source[:PARTICIPANT]
        if name == UNKNOWN:
            return participant in self._participants
        mine = self._node.get_fully_qualified_name()
        return name == mine or name in self._names or participant in self._nameless


def _participant(info: Any) -> str:
    return bytes(info.endpoint_gid).hex()[:PARTICIPANT]


def doubled(node: Node) -> list[str]:
    """The names that several nodes have, `node` among them: what is asked by a name is told of one of them."""
    counts = Counter(node.get_node_names_and_namespaces())
    return sorted(_full(*named) for named, count in counts.items() if count > 1)


def _count_clients(node: Node, service: str) -> int:
    if hasattr(node, "count_clients"):
        return int(node.count_clients(service))
    return len(node.get_publishers_info_by_topic(f"rq{service}Request", no_mangle=True))  # Humble, on DDS


def count_services(node: Node, service: str) -> int:
    """How many serve a service by its whole name."""
    return int(node.count_services(service)) if hasattr(node, "count_services") else len(servers(node, service))


def _besides(node: Node, count: int, read: Named, wanted: str) -> list[str]:
    """The others that have what is wanted, of which there are `count` and one is the node's own."""
    if count <= 1:  # the usual case, in which nobody is asked
        return []
    found = [_full(name, space) for name, space in _others(node) if wanted in dict(_read(read, name, space))]
    names = " or ".join(doubled(node))
    return found or [f"another node named {names}" if names else "a node of unknown name"]


def _look(node: Node) -> dict[str, Any]:
    return {"nodes": [_describe(node, name, space) for name, space in _others(node)]}


def _others(node: Node) -> list[tuple[str, str]]:
    own = (node.get_name(), node.get_namespace())
    return sorted(set(node.get_node_names_and_namespaces()) - {own})


def _full(name: str, space: str) -> str:
    return f"{space.rstrip('/')}/{name}"


def _read(read: Named, name: str, space: str) -> list[tuple[str, list[str]]]:
    try:
        return read(name, space)
    except Exception:  # noqa: BLE001 - the node has ended meanwhile
        return []


def _describe(node: Node, name: str, space: str) -> dict[str, Any]:
    reads: dict[str, Named] = {
        "publishes": node.get_publisher_names_and_types_by_node,
        "subscribes": node.get_subscriber_names_and_types_by_node,
        "serves": node.get_service_names_and_types_by_node,
        "calls": node.get_client_names_and_types_by_node,
    }
    found: dict[str, Any] = {"name": _full(name, space)}
    for key, read in reads.items():
        found[key] = {n: sorted(types) for n, types in sorted(_read(read, name, space)) if not _is_noise(n)}
    return found


def _is_noise(name: str) -> bool:
    """Whether every node has it, so that it is nothing of the robot's own."""
    return name in NOISE or name.rpartition("/")[2] in PARAMETERS
