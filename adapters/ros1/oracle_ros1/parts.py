"""The parts of a monitor: what observes a topic, a service or an action, by its type and by whether it is filtered.

Another type of interface is a row here, and a file of its own.
"""

from __future__ import annotations

from typing import Callable, List, Mapping, Optional, Protocol, Sequence, Tuple

import rospy
from oracle_adapter import TimeSource
from oracle_adapter.interfaces import Interface
from oracle_adapter.kinds import InterfaceType
from rospy.impl import registration

from oracle_ros1.actionproxy import ProxiedAction
from oracle_ros1.actions import LoggedAction
from oracle_ros1.actiontopics import TO_CLIENT, TO_SERVER
from oracle_ros1.codec import CodecError
from oracle_ros1.definitions import ros1_name
from oracle_ros1.services import ProxiedService
from oracle_ros1.shared import Shared
from oracle_ros1.topics import FilteredTopic, LoggedTopic


class PartStream(Protocol):
    """One stream that a part observes."""

    name: str
    kind: str

    @property
    def latency(self) -> Optional[int]:
        """How late its messages may be (ns); None where they are stamped here, under the link's lock."""

    @property
    def time_source(self) -> Optional[TimeSource]:
        """Where its times come from; None while that is not known."""


class Part(Protocol):
    """What observes one topic, service or action."""

    @property
    def streams(self) -> Sequence[PartStream]:
        """Its streams; troubles are those of the first."""

    @property
    def bypass(self) -> str:
        """What lets events past the monitor, as of the last look; empty where nothing does."""

    @property
    def doubt(self) -> str:
        """What may be wrong, as of the last look; empty for nothing."""

    def look(self) -> str:
        """What is wrong, empty for nothing; to be called from time to time."""

    def stop(self) -> None:
        """Take and forward no more, and wait for nobody."""

    def leave(self) -> None:
        """Unregister at the master, which may hang."""


def action_part(shared: Shared, action: Interface) -> Part:
    """What observes an action: its topics as they are, or those of its proxy."""
    via = next(iter(action.streams.values())).get("via")
    return LoggedAction(shared, action) if via == "introspection" else ProxiedAction(shared, action)


MAKERS: Mapping[Tuple[InterfaceType, bool], Callable[[Shared, Interface], Part]] = {
    ("topic", False): LoggedTopic,
    ("topic", True): FilteredTopic,
    ("service", False): ProxiedService,
    ("service", True): ProxiedService,
    ("action", False): action_part,
    ("action", True): action_part,
}


def make_part(shared: Shared, interface: Interface) -> Part:
    """Observe an interface from now on.

    Raises `CodecError` where its type is not there, or this node has the topic as another one, as `/diagnostics`.
    """
    if interface.type == "topic" and interface.first["type"]:
        _demand_type(shared, interface, ros1_name(interface.first["type"]))
    return MAKERS[interface.type, interface.filtered](shared, interface)


def _demand_type(shared: Shared, topic: Interface, wanted: str) -> None:
    for name in filter(None, (topic.name, topic.proxy)):
        own = registration.get_topic_manager().get_publisher_impl(rospy.resolve_name(shared.names[name]))
        has = own.data_class._type if own else wanted  # noqa: SLF001 - genpy's own interface
        if has != wanted:
            raise CodecError(f"{topic.name} can't be observed as {wanted}: this node itself publishes {has} there")


def names_on_graph(of: InterfaceType, name: str) -> List[str]:
    """All names of an interface that is called so, as ROS's remaps of this node make them."""
    topics = [f"{name}/{kind}" for kind in (*TO_SERVER, *TO_CLIENT)] if of == "action" else [name]
    return [str(rospy.resolve_name(topic)) for topic in topics]
