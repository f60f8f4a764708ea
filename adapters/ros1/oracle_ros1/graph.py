"""Who publishes and serves what, as the master tells."""

from __future__ import annotations

import threading
from typing import Any, Dict, List, Optional

import rospy

PERIOD = 1.0
"""Seconds between two questions."""


NOISE = ("/rosout", "/rosout_agg")
SERVICES = ("/get_loggers", "/set_logger_level")  # that every node has


def dump_graph() -> Dict[str, Any]:
    """The graph without this node, as `oracle-server check --ros-graph` reads it: types by the names of topics.

    ROS 1 does not tell who calls a service.
    """
    master = rospy.get_master()
    _, _, types = master.getTopicTypes()
    _, _, (publishers, subscribers, services) = master.getSystemState()
    kinds = {topic: [kind] for topic, kind in types}
    nodes: Dict[str, Any] = {}
    for key, entries in (("publishes", publishers), ("subscribes", subscribers), ("serves", services)):
        for name, users in entries:
            if name in NOISE or (key == "serves" and name.endswith(SERVICES)):
                continue
            for user in users:
                blank: Dict[str, Any] = {"name": user, "publishes": {}, "subscribes": {}, "serves": {}, "calls": {}}
                nodes.setdefault(user, blank)[key][name] = kinds.get(name, [])
    nodes.pop(rospy.get_name(), None)
    return {"nodes": [nodes[name] for name in sorted(nodes)]}


class Graph:
    """Asks in a thread of its own, from `start` to `stop`: a master can be far away, and nothing must wait for it."""

    def __init__(self) -> None:
        self._publishers: Dict[str, List[str]] = {}
        self._servers: Optional[Dict[str, List[str]]] = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="oracle-graph", daemon=True)

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def stop(self) -> None:
        """Ask no more."""
        self._stopping.set()

    def others(self, topic: str) -> List[str]:
        """The nodes but this one that published a topic when the master was last asked."""
        return sorted(set(self._publishers.get(topic, ())) - {rospy.get_name()})

    def not_serving(self, service: str) -> str:
        """Why calls of a service of this node's do not reach it, as of the master's last word; empty where they do.

        The name of a service is its last server's. Who calls a service is not known to the master.
        """
        if self._servers is None:
            return ""
        servers = self._servers.get(service, [])
        others = [
            f"{server} serves {service} in the monitor's place" for server in servers if server != rospy.get_name()
        ]
        return "; ".join(others) if servers else f"the master does not know {service} any more; start the monitor again"

    def _ask(self) -> None:
        master = rospy.get_master()
        while not self._stopping.wait(PERIOD):
            try:
                _, _, (publishers, _, servers) = master.getSystemState()
            except (OSError, ValueError, TypeError):  # no master, or none that makes sense
                continue
            self._publishers = {str(topic): list(nodes) for topic, nodes in publishers}
            self._servers = {str(service): list(nodes) for service, nodes in servers}
