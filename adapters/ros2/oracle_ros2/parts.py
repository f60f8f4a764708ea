"""The parts of a monitor: what observes a topic, a service or an action, by its type and by whether it is filtered.

Another type of interface is a row here, and a file of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Callable, Mapping, Protocol, Sequence

from rclpy.exceptions import NameValidationException

from oracle_ros2.actions import ProxiedAction
from oracle_ros2.introspected import IntrospectedAction
from oracle_ros2.services import ProxiedService
from oracle_ros2.topics import FilteredTopic, LoggedTopic

if TYPE_CHECKING:
    from oracle_adapter import TimeSource
    from oracle_adapter.interfaces import Interface
    from oracle_adapter.kinds import InterfaceType
    from rclpy.node import Node

    from oracle_ros2.shared import Shared


class PartStream(Protocol):
    """One stream that a part observes."""

    name: str
    kind: str
    latency: int | None
    """How late its messages may be (ns); None where they are stamped here, under the link's lock."""
    time_source: TimeSource
    """Where its times come from."""


class Part(Protocol):
    """What observes one topic, service or action; all is called where callbacks run."""

    streams: Sequence[PartStream]
    """Its streams; troubles are those of the first."""

    @property
    def bypass(self) -> str:
        """What lets events past the monitor, as of the last look; empty where nothing does."""

    @property
    def doubt(self) -> str:
        """What may be wrong, as of the last look; empty for nothing."""

    @property
    def received(self) -> int:
        """How many messages have come that show whether the middleware delivers; calls are too rare."""

    def catch_up(self) -> None:
        """Take what has come by now, and continue with what waits; to be called often."""

    def look(self) -> str:
        """Look at the other nodes, and return what is wrong, empty for nothing; to be called from time to time."""

    def stop(self) -> None:
        """Take and forward no more."""


def _action(shared: Shared, action: Interface) -> Part:
    introspected = action.first.get("via") == "introspection"
    return IntrospectedAction(shared, action) if introspected else ProxiedAction(shared, action)


MAKERS: Mapping[tuple[InterfaceType, bool], Callable[[Shared, Interface], Part]] = {
    ("topic", False): LoggedTopic,
    ("topic", True): FilteredTopic,
    ("service", False): ProxiedService,
    ("service", True): ProxiedService,
    ("action", False): _action,
    ("action", True): ProxiedAction,
}


def make_part(shared: Shared, interface: Interface) -> Part:
    """Observe an interface from now on.

    Raises `CodecError` where its type is not there, ValueError where ROS does not let it be observed: this process may
    have the topic as another type, as `/diagnostics` and `/rosout`, or the name is none.
    """
    try:
        return MAKERS[interface.type, interface.filtered](shared, interface)
    except (RuntimeError, NameValidationException) as error:  # rcl's errors are of the first class
        raise ValueError(f"{interface.name} can't be observed as {interface.first['type']}: {error}") from error


def names_on_graph(node: Node, of: InterfaceType, name: str) -> list[str]:
    """What an interface is called that has this name here, as ROS's remaps of this node make it."""
    try:
        if of == "topic":
            return [node.resolve_topic_name(name)]
        return [node.resolve_service_name(f"{name}/_action/send_goal" if of == "action" else name)]
    except NameValidationException:  # to observe it fails, too, and says why
        return [name]
